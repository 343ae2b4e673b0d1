"""Pictures of scenes in which one target is not as it should be, with known truth.

A finger, glare, a torn edge or a stain spoils up to a quarter of one side; paper curls along a
side; or a target is not a square.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from trisquare.simulate import random_scene
from trisquare.simulate.render import Image, render
from trisquare.simulate.scene import Scene, Side, SideSamples, Target, rectangle, sample_sides
from trisquare_scenes.occluders import Array, Overlay, polygon_mask, spot_mask

DamageKind = Literal[
    "finger", "glare", "torn", "stain", "curl", "rectangle", "trapezium", "false_of_three"
]
KINDS: tuple[DamageKind, ...] = get_args(DamageKind)

HIDDEN_RANGE = (0.08, 0.25)
"""Range of the hidden fraction of a side's length."""

MIN_HIDDEN = 0.05
"""Minimum of the hidden fraction; a draw that hides less is repeated."""

TOUCHED = 0.02
"""Mask value above which a point of an edge counts as hidden."""

PLACE_RANGE = (0.15, 0.85)
"""Range of the middle of the hidden stretch, from corner to corner."""

BOW_RANGE = (0.5, 3.0)
"""Range of the bend of a curled side at its middle, pixels of the picture."""

RECTANGLE_RATIO = 1.1
TRAPEZIUM_RANGE = (0.05, 0.10)
"""Ratio of a rectangle's sides, and range of the relative shortening of a trapezium's one side."""

SKIN = np.array([0.45, 0.62, 1.0])
SKIN_RANGE = (0.15, 0.5)
"""Light of skin, blue to red, relative to red; and the range of its red."""

FINGER_LENGTHS = (60.0, 6.0, 4.0, 2.5, 1.6)
"""Lengths that are tried, in finger widths: out of the picture if that hides nothing else."""

MAX_DRAWS = 400
"""Maximum number of placements; they are drawn by rejection, and one in a few is accepted."""


@dataclass(frozen=True, slots=True)
class Damage:
    """The damage in a picture, and its place.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    plane : int
        Index of the damaged target.
    side : int or None
        Index of the damaged side of its outer outline; None if the whole target is false.
    extent : float
        Hidden fraction of that side; or the bow of a curled side, pixels; or the relative
        departure of a false target from a square.
    hidden : tuple of (target, outline, side, share)
        Every side that is partly hidden, a frame's inner outline being its outline 1.
    """

    kind: DamageKind
    plane: int
    side: int | None
    extent: float
    hidden: tuple[tuple[int, int, int, float], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class BentSide(Side):
    """A side whose middle is bent outward by `bow`, plane units."""

    bow: float

    def points(self, fraction: Array) -> Array:
        """Return points at fractions of the chord, shape (N, 2)."""
        chord = self.end - self.start
        outward = np.array([chord[1], -chord[0]]) / np.hypot(*chord)
        height = 4.0 * self.bow * fraction * (1.0 - fraction)
        bent: Array = Side.points(self, fraction) + height[:, None] * outward
        return bent


@dataclass(frozen=True, slots=True, eq=False)
class CurledTarget(Target):
    """A square or a frame on paper that curls.

    Parameters
    ----------
    bows : ndarray, shape (4,)
        Outward bend of each side's middle, plane units. A frame's inner side bends less, by the
        square of its distance from the middle.
    """

    bows: Array = field(default_factory=lambda: np.zeros(4))

    def outline_sides(self) -> list[list[Side]]:
        """Return the sides of each of `outlines`."""
        bows = (self.bows.tolist(), (self.inner**2 * self.bows).tolist())
        return [
            [BentSide(side.start, side.end, bow) for side, bow in zip(sides, bent, strict=True)]
            for sides, bent in zip(Target.outline_sides(self), bows, strict=False)
        ]


class _Place(NamedTuple):
    """A stretch of a side where something is to be hidden."""

    middle: Array  # pixels
    inward: Array  # unit normal
    along: Array  # unit tangent
    stretch: float  # length to hide, pixels
    side_length: float


def damaged_scene(
    rng: np.random.Generator,
    kind: DamageKind,
    image_size: tuple[int, int] = (1280, 960),
) -> tuple[Image, Scene, Damage]:
    """Draw a scene with one damage and photograph it.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    kind : str
        One of `KINDS`: ``"finger"``, ``"glare"``, ``"torn"`` and ``"stain"`` spoil 8 to 25 % of a
        side of one of three targets, ``"curl"`` bends one by 0.5 to 3 pixels; ``"rectangle"``
        (1.1 : 1) and ``"trapezium"`` are false squares among four or five targets,
        ``"false_of_three"`` is one of them among three.
    image_size : tuple of int
        Width and height, pixels.

    Returns
    -------
    picture : ndarray of uint8, shape (H, W) or (H, W, 3)
    scene : Scene
        The truth, including the false shape of a target.
    damage : Damage
    """
    if kind not in KINDS:
        raise ValueError(f"unknown damage {kind!r}: choose among {', '.join(KINDS)}")
    frame = rng.random() < 0.5
    count = int(rng.integers(4, 6)) if kind in ("rectangle", "trapezium") else 3
    scene = random_scene(
        rng,
        image_size=image_size,
        kind="frame" if frame else "square",
        count=count,
        dark=bool(rng.random() < 0.8),
    )
    settings = _settings(rng)
    plane = int(rng.integers(count))
    if kind == "curl":
        scene, damage = _curled(scene, plane, rng)
    elif kind in ("rectangle", "trapezium", "false_of_three"):
        scene, damage = _false_square(scene, plane, kind, rng)
    else:
        overlay, damage = _hidden_stretch(scene, plane, kind, rng, settings)
        settings["overlays"] = [overlay]
    return render(scene, rng, **settings), scene, damage


def _settings(rng: np.random.Generator) -> dict[str, Any]:
    """Draw the conditions of the picture."""
    return {
        "noise": rng.uniform(1.0, 4.0),
        "blur": rng.uniform(0.5, 1.2),
        "contrast": rng.uniform(130.0, 200.0),
        "tone": "srgb",
        "colour": bool(rng.random() < 0.5),
        "shading": rng.uniform(0.0, 0.3),
        "clutter": int(rng.integers(20, 60)) if rng.random() < 0.5 else 0,
    }


def _with_target(scene: Scene, plane: int, target: Target) -> Scene:
    targets = list(scene.targets)
    targets[plane] = target
    return replace(scene, targets=tuple(targets))


def _curled(scene: Scene, plane: int, rng: np.random.Generator) -> tuple[Scene, Damage]:
    """Bend one side outward or inward."""
    side = int(rng.integers(4))
    pixels = float(rng.uniform(*BOW_RANGE))
    start, end = np.roll(scene.targets[plane].outlines()[0], -side, axis=0)[:2]
    middle = 0.5 * (start + end)
    step = 1e-4 * np.array([end[1] - start[1], start[0] - end[0]])
    pixels_seen = scene.image_points(plane, np.array([start, end, middle - step, middle + step]))
    chord = (pixels_seen[1] - pixels_seen[0]) / np.hypot(*(pixels_seen[1] - pixels_seen[0]))
    move = pixels_seen[3] - pixels_seen[2]
    per_unit = abs(chord[0] * move[1] - chord[1] * move[0]) / (2.0 * np.hypot(*step))
    bows = np.zeros(4)
    bows[side] = rng.choice([-1.0, 1.0]) * pixels / per_unit
    target = scene.targets[plane]
    curled = CurledTarget(
        target.rotation, target.translation, target.kind, target.dark, target.inner, bows=bows
    )
    return _with_target(scene, plane, curled), Damage("curl", plane, side, pixels)


def _false_square(
    scene: Scene, plane: int, kind: DamageKind, rng: np.random.Generator
) -> tuple[Scene, Damage]:
    """Make a target a rectangle or a trapezium."""
    shape = kind
    if kind == "false_of_three":
        shape = "rectangle" if rng.random() < 0.5 else "trapezium"
    if shape == "rectangle":
        # Of the same area as the square that it replaces.
        stretch = np.sqrt(RECTANGLE_RATIO)
        printed = rectangle(0.5 * stretch, 0.5 / stretch)
        departure = RECTANGLE_RATIO - 1.0
    else:
        departure = float(rng.uniform(*TRAPEZIUM_RANGE))
        printed = rectangle(0.5, 0.5)
        printed[:2, 0] *= 1.0 - departure
    if rng.random() < 0.5:  # the other pair of sides; a quarter turn keeps the order
        printed = np.roll(printed @ np.array([[0.0, 1.0], [-1.0, 0.0]]), -1, axis=0)
    false_target = replace(scene.targets[plane], printed=printed)
    return _with_target(scene, plane, false_target), Damage(kind, plane, None, departure)


def _hidden_stretch(
    scene: Scene, plane: int, kind: DamageKind, rng: np.random.Generator, settings: dict[str, Any]
) -> tuple[Overlay, Damage]:
    """Hide a stretch of one side, and nothing else except what lies behind it in the same frame."""
    sides = [sample_sides(scene.camera, target, 1.0) for target in scene.targets]
    for _ in range(MAX_DRAWS):
        side = int(rng.integers(4))
        place = _draw_place(sides[plane][side], rng)
        for overlay in _overlays(kind, place, scene, rng, settings):
            hidden = tuple(_hidden_shares(overlay, sides))
            share = {(t, o, s): part for t, o, s, part in hidden}
            own_share = share.get((plane, 0, side), 0.0)
            others_hidden = [
                key for key in share if key[:2] != (plane, 1) and key != (plane, 0, side)
            ]
            if (
                own_share >= MIN_HIDDEN
                and not others_hidden
                and max(share.values()) <= HIDDEN_RANGE[1]
            ):
                return overlay, Damage(kind, plane, side, own_share, hidden)
    raise ValueError(f"no {kind} hides a part of one side only in this scene")


def _draw_place(side: SideSamples, rng: np.random.Generator) -> _Place:
    index = int(rng.uniform(*PLACE_RANGE) * len(side.image))
    inward = side.normal[index]
    return _Place(
        middle=side.image[index],
        inward=inward,
        along=np.array([inward[1], -inward[0]]),
        stretch=float(rng.uniform(*HIDDEN_RANGE)) * side.length,
        side_length=side.length,
    )


def _hidden_shares(
    overlay: Overlay, sides: list[list[SideSamples]]
) -> Iterator[tuple[int, int, int, float]]:
    """Yield the touched fraction of every side that is touched."""
    for target, samples in enumerate(sides):
        for index, side in enumerate(samples):
            x, y = np.rint(side.image).astype(int).T
            share = float(np.mean(overlay.mask[y, x] > TOUCHED))
            if share > 0.0:
                yield target, index // 4, index % 4, share


def _overlays(
    kind: DamageKind,
    place: _Place,
    scene: Scene,
    rng: np.random.Generator,
    settings: dict[str, Any],
) -> Iterator[Overlay]:
    """Yield overlays that may hide a place, in order of preference."""
    size, blur = scene.camera.image_size, settings["blur"]
    if kind == "finger":
        yield from _fingers(place, size, blur, rng, bool(settings["colour"]))
    elif kind == "torn":
        # The torn part shows the paper beside it.
        ground_pixel = np.rint(place.middle - (6.0 + 4.0 * blur) * place.inward).astype(int)
        bite = polygon_mask(_bite(place, rng), size, blur)
        yield Overlay(bite, 1.0, (int(ground_pixel[0]), int(ground_pixel[1])))
    elif kind == "glare":
        across = place.stretch * rng.uniform(0.3, 0.8)
        # The mask of a spot falls to `TOUCHED` at 1.4 of its half widths.
        spot = spot_mask(place.middle, place.along, (place.stretch / 2.8, across), size)
        yield Overlay(spot, 0.0, np.array([rng.uniform(0.7, 2.0)]))
    else:
        yield Overlay(_stain_mask(place, size, blur, rng), rng.uniform(0.2, 0.6), np.zeros(1))


def _fingers(
    place: _Place, size: tuple[int, int], blur: float, rng: np.random.Generator, colour: bool
) -> Iterator[Overlay]:
    """Yield fingers of decreasing length that reach over a side from outside."""
    slant = np.deg2rad(rng.uniform(-30.0, 30.0))
    outward = -np.cos(slant) * place.inward + np.sin(slant) * place.along
    width = 0.95 * place.stretch * np.cos(slant)
    tip = place.middle - outward * width * rng.uniform(0.2, 0.9)
    light = rng.uniform(*SKIN_RANGE) * (SKIN if colour else np.array([SKIN.mean()]))
    across = np.array([-outward[1], outward[0]])
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 25)
    for length in FINGER_LENGTHS:
        # From the round tip to a round end, growing a little wider.
        polygon = np.concatenate(
            [
                end
                + radius
                * (np.sin(angle)[:, None] * across * turn - np.cos(angle)[:, None] * end_direction)
                for end, radius, turn, end_direction in (
                    (tip, 0.5 * width, 1.0, outward),
                    (tip + length * width * outward, 0.6 * width, -1.0, -outward),
                )
            ]
        )
        mask = polygon_mask(polygon, size, blur)
        # A finger is round: darker toward its rim.
        relief = 0.6 + 0.4 * polygon_mask(polygon, size, 0.25 * width)
        yield Overlay(mask, 1.0, relief[..., None] * light)


def _bite(place: _Place, rng: np.random.Generator) -> Array:
    """Return the jagged outline of a piece that is torn out of a side."""
    teeth = int(rng.integers(5, 14))
    along = np.linspace(-0.5, 0.5, teeth) * 0.95 * place.stretch
    depth = place.side_length * rng.uniform(0.015, 0.10) * rng.uniform(0.3, 1.0, teeth)
    depth[[0, -1]] = -8.0  # beyond the edge's own blur
    torn = place.middle + along[:, None] * place.along + depth[:, None] * place.inward
    return np.asarray(torn, dtype=np.float64)


def _stain_mask(
    place: _Place, size: tuple[int, int], blur: float, rng: np.random.Generator
) -> Array:
    """Return a blob with a wavy, more or less soft rim, across the side or beside it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    waves = sum(
        rng.normal(0.0, 0.12 / k) * np.cos(k * angle + rng.uniform(0.0, 2.0 * np.pi))
        for k in range(2, 6)
    )
    radius = 0.5 * place.stretch * (1.0 + np.asarray(waves))
    centre = place.middle - rng.uniform(-0.3, 0.8) * 0.5 * place.stretch * place.inward
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return polygon_mask(centre + radius[:, None] * rim, size, blur + rng.uniform(0.0, 6.0))
