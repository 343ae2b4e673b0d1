"""Scenes in which true squares lie among rectangles: windows, screens, books, tiles.

Like the squares, the rectangles are seen in perspective, often in rows of equal ones, and parallel
or perpendicular to something else, as things that people build are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trisquare._support.convex_quads import apart
from trisquare._support.rotations import tilted
from trisquare.simulate import random_camera
from trisquare.simulate.render import SHEET_RIM, Image, render
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import faces_camera, inside

TRUE_SIDES = (0.20, 0.32)
"""Range of the true squares' sides, over the picture's height: three leave room for ten others."""

MORE_TRUE_SIDES = (0.16, 0.26)
"""The same for four squares and more."""

FALSE_SIDES = (0.09, 0.26)
"""Range of the geometric mean of a rectangle's sides, over the picture's height."""

TRUE_TILTS = (25.0, 50.0)
TRUE_JITTER = 20.0
"""Range of tilts, and jitter of their otherwise evenly spread directions as in `random_scene`,
degrees."""

SLENDER, BROAD = (0.4, 0.95), (1.05, 2.5)
NEARLY_SQUARE = ((0.9, 0.97), (1.03, 1.1))
NEARLY_SQUARE_SHARE = 0.15
"""Ranges of the rectangles' aspect ratios, and the fraction that is hard to distinguish from a
square."""

ROW_SHARE = 0.25
ROW_LENGTHS = (2, 4)
ROW_GAPS = (0.35, 0.6)
"""Fraction of rectangles in rows of 2 to 4 equal ones, and the gaps of these, in shorter sides."""

STANCES = {"parallel": 0.35, "perpendicular": 0.25, "picture": 0.1, "free": 0.3}
"""Probabilities of a rectangle's orientation: parallel or perpendicular to a target that is there
already, in the plane of the picture, or random."""

FREE_TILTS = (0.0, 60.0)
EDGE = 0.04
"""Minimum distance of centres from the picture's border, as a fraction of the picture."""

MAX_SCENES = 60
MAX_PLACES = 400
"""Maximum numbers of scenes, and of places within one: both are drawn by rejection."""


@dataclass(frozen=True, slots=True, eq=False)
class MixedScene:
    """A scene and which of its targets are true squares."""

    scene: Scene
    is_square: tuple[bool, ...]


def mixed_scene(
    rng: np.random.Generator,
    *,
    squares: int = 3,
    rectangles: int = 10,
    camera: TrueCamera | None = None,
    image_size: tuple[int, int] = (1280, 960),
) -> MixedScene:
    """Draw true squares among rectangles, all inside the picture and clear of one another.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    squares, rectangles : int
        Numbers of squares and of rectangles.
    camera : TrueCamera, optional
        The camera; drawn if not given.
    image_size : tuple of int
        Width and height, pixels; those of `camera` if that is given.

    Returns
    -------
    MixedScene
    """
    for _ in range(MAX_SCENES):
        drawn = camera or random_camera(rng, image_size)
        targets = _true_squares(drawn, rng, squares)
        if targets is not None and _add_rectangles(drawn, rng, targets, squares + rectangles):
            is_square = tuple(i < squares for i in range(len(targets)))
            return MixedScene(Scene(drawn, tuple(targets)), is_square)
    raise ValueError(f"no {squares} squares and {rectangles} rectangles fit this camera's picture")


def photograph(mixed: MixedScene, rng: np.random.Generator) -> Image:
    """Render a mixed scene under ordinary conditions, drawn at random."""
    settings: dict[str, Any] = {
        "noise": rng.uniform(1.0, 4.0),
        "blur": rng.uniform(0.5, 1.2),
        "contrast": rng.uniform(130.0, 200.0),
        "tone": "srgb",
        "shading": rng.uniform(0.0, 0.3),
    }
    return render(mixed.scene, rng, **settings)


def _true_squares(camera: TrueCamera, rng: np.random.Generator, count: int) -> list[Target] | None:
    targets: list[Target] = []
    first = rng.uniform(0.0, 360.0)
    sides = TRUE_SIDES if count < 4 else MORE_TRUE_SIDES
    for i in range(count):
        direction = first + 360.0 * i / count
        for _ in range(MAX_PLACES):
            rotation = tilted(
                rng.uniform(*TRUE_TILTS),
                direction + rng.uniform(-TRUE_JITTER, TRUE_JITTER),
                rng.uniform(0.0, 360.0),
            )
            side = camera.image_size[1] * rng.uniform(*sides)
            target = _placed(camera, rng, rotation, side, None, frame=rng.random() < 0.3)
            if target is not None and _is_clear(target, targets):
                targets.append(target)
                break
        else:
            return None
    return targets


def _add_rectangles(
    camera: TrueCamera, rng: np.random.Generator, targets: list[Target], total: int
) -> bool:
    """Add rectangles until there are `total` targets; False if they do not fit."""
    for _ in range(MAX_PLACES):
        if len(targets) == total:
            return True
        rotation = _stance(rng, targets)
        side = camera.image_size[1] * rng.uniform(*FALSE_SIDES)
        printed = _shape(rng)
        target = _placed(camera, rng, rotation, side, printed, frame=rng.random() < 0.4)
        if target is None or not _is_clear(target, targets):
            continue
        targets.append(target)
        if rng.random() < ROW_SHARE:
            _continue_row(camera, rng, targets, total)
    return len(targets) == total


def _continue_row(
    camera: TrueCamera, rng: np.random.Generator, targets: list[Target], total: int
) -> None:
    """Repeat the last target along one of its directions, as far as there is room."""
    first = targets[-1]
    half = np.array(first.extent)
    gap = 2.0 * half.min() * rng.uniform(*ROW_GAPS)
    axis = int(rng.integers(2))
    step = rng.choice([-1.0, 1.0]) * (2.0 * half[axis] + gap) * first.rotation[:, axis]
    for i in range(1, int(rng.integers(ROW_LENGTHS[0], ROW_LENGTHS[1] + 1))):
        centre = first.translation + i * step
        if len(targets) == total or centre[2] <= 0.0 or not faces_camera(first.rotation, centre):
            return
        again = Target(
            first.rotation, centre, first.kind, first.dark, first.inner, printed=first.printed
        )
        if not inside(camera, again) or not _is_clear(again, targets):
            return
        targets.append(again)


def _stance(rng: np.random.Generator, targets: list[Target]) -> Array:
    """Draw the orientation of a rectangle."""
    stance = rng.choice(list(STANCES), p=list(STANCES.values()))
    if stance == "picture":
        return tilted(0.0, 0.0, rng.uniform(0.0, 360.0))
    if stance == "free" or not targets:
        return tilted(rng.uniform(*FREE_TILTS), rng.uniform(0.0, 360.0), rng.uniform(0.0, 360.0))
    turned = targets[rng.integers(len(targets))].rotation
    x, y, _ = turned.T
    if stance == "perpendicular":
        choice = int(rng.integers(4))
        sideways = (x, -x, y, -y)[choice]
        axis = (y, y, x, x)[choice]
        turned = np.stack([axis, np.cross(sideways, axis), sideways], axis=1)
    if rng.random() < 0.3:
        turned = turned @ tilted(0.0, 0.0, rng.uniform(0.0, 360.0))
    return np.asarray(turned)


def _shape(rng: np.random.Generator) -> Array:
    """Return corners of a rectangle of unit area, plane units."""
    close = rng.random() < NEARLY_SQUARE_SHARE
    ranges = NEARLY_SQUARE if close else (SLENDER, BROAD)
    low, high = ranges[rng.integers(2)]
    stretch = np.sqrt(np.exp(rng.uniform(np.log(low), np.log(high))))
    return rectangle(0.5 * stretch, 0.5 / stretch)


def _placed(
    camera: TrueCamera,
    rng: np.random.Generator,
    rotation: Array,
    side: float,
    printed: Array | None,
    *,
    frame: bool,
) -> Target | None:
    """Place a figure at random in the picture; None if it does not face the camera there."""
    pixel = rng.uniform(EDGE, 1.0 - EDGE, 2) * camera.image_size
    centre = np.append(camera.undistort(pixel[None])[0], 1.0) * camera.fx / side
    if not faces_camera(rotation, centre):
        return None
    target = Target(rotation, centre, "frame" if frame else "square", printed=printed)
    return target if inside(camera, target) else None


def _is_clear(target: Target, placed: list[Target]) -> bool:
    """Return whether a figure with its rim of ground meets no other in the picture."""
    outline = _seen_with_rim(target)
    other_outlines = [_seen_with_rim(placed_target) for placed_target in placed]
    return outline is not None and all(
        quad is not None and apart(outline, quad) for quad in other_outlines
    )


def _seen_with_rim(target: Target) -> Array | None:
    """Return the ideal image of a figure with its rim; distortion would not change overlaps."""
    half = np.array(target.extent)
    corners = target.to_camera(rectangle(*(half + 2.0 * SHEET_RIM[1] * half.min())))
    if np.any(corners[:, 2] <= 0.0):
        return None
    return np.asarray(corners[:, :2] / corners[:, 2:])
