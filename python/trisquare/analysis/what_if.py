"""Other set-ups that a calibration might have had: the same planes tilted, closer, or more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import any_meet
from trisquare.analysis.plan import UNIT_SQUARE, ideal_point, outlines_of, tilted
from trisquare.camera.camera import Camera, camera_parameters

if TYPE_CHECKING:
    from trisquare.results.calibration import Calibration
    from trisquare.results.plane import Plane

MORE_TILT = 10.0  # degrees
LARGER = 1.25
NEARER = 0.1  # of the picture's size
# A plane tilted less than this (degrees) shows no direction to tilt it further in.
LEAST_TILT = 1.0
FURTHER_TILT = 35.0  # degrees, of a square that is added
# Places for a square that is added, parts of the picture.
FURTHER_PLACES = {
    "upper left": (0.25, 0.25),
    "upper right": (0.75, 0.25),
    "lower left": (0.25, 0.75),
    "lower right": (0.75, 0.75),
}
# Any will do: only ratios of predicted standard deviations are used.
SIGMA = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A plane somewhere, with the outlines on it."""

    rotation: FloatArray
    translation: FloatArray
    outlines: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A camera and the planes it sees, with what is held."""

    camera: Camera
    planes: tuple[Standing, ...]
    fixed: tuple[str, ...]

    def std(self) -> dict[str, float]:
        """Predict the standard deviations, up to the noise that is common to all plans.

        Raises
        ------
        ValueError
            If a plane is not wholly in the picture.
        TrisquareError
            If nothing is determined.
        """
        found = _core.predict(
            list(camera_parameters(self.camera).values()),
            self.camera.image_size,
            [(p.rotation, p.translation.tolist(), list(p.outlines)) for p in self.planes],
            sigma=SIGMA,
            spacing=1.0,
            model=self.camera.model,
            fixed=self.fixed,
            judged=False,
        )
        return found["std"]


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """A change of the set-up, as a noun phrase, and what its lack is called, if it is one."""

    change: str
    lack: str
    planned: Planned


def planes_of(calibration: Calibration) -> tuple[Standing, ...]:
    """Return the planes as they were found."""
    return tuple(
        Standing(plane.rotation, plane.translation, _outlines(calibration.camera, plane))
        for plane in calibration.planes
    )


def _outlines(camera: Camera, plane: Plane) -> tuple[FloatArray, ...]:
    """Outlines on a plane: of a lattice, the rectangle between its outermost corners."""
    if plane.kind in ("square", "tag", "frame"):
        return tuple(outlines_of(plane))
    to_plane = np.linalg.inv(np.column_stack([plane.rotation[:, :2], plane.translation]))
    corners = []
    for corner in plane.corners:
        point = to_plane @ np.append(ideal_point(camera, corner), 1.0)
        corners.append(point[:2] / point[2])
    return (np.array(corners),)


def alternatives_of(
    calibration: Calibration, planes: tuple[Standing, ...]
) -> Iterator[Alternative]:
    """Yield the set-ups worth comparing with the one that was photographed."""
    camera, fixed = calibration.camera, calibration.fixed

    def changed(new: tuple[Standing, ...]) -> Planned:
        return Planned(camera, new, fixed)

    more = tuple(_tilted_more(plane, i, len(planes)) for i, plane in enumerate(planes))
    low, high = _tilts(planes)
    tilts = f"{low:.0f}" if round(low) == round(high) else f"{low:.0f} to {high:.0f}"
    yield Alternative(
        f"tilting every square {MORE_TILT:g} degrees more",
        f"the squares are tilted by only {tilts} degrees",
        changed(more),
    )
    larger = tuple(
        Standing(plane.rotation, plane.translation / LARGER, plane.outlines) for plane in planes
    )
    yield Alternative(
        f"showing the squares {LARGER:g} times larger", "the squares are small", changed(larger)
    )
    for number, plane in enumerate(planes):
        moved = _nearer_to_corner(camera, plane)
        if moved is not None:
            yield Alternative(
                f"moving square {number} nearer to the corner of the picture",
                "the squares leave the picture's corners empty",
                changed((*planes[:number], moved, *planes[number + 1 :])),
            )
    for where, place in FURTHER_PLACES.items():
        further = _further_square(camera, planes, place)
        if further is not None:
            yield Alternative(
                f"a further square in the picture's {where}, tilted in a direction of its own,",
                "the squares are few",
                changed((*planes, further)),
            )
    if all(plane.kind in ("square", "tag") for plane in calibration.planes):
        frame = tuple(outlines_of(_Frame()))
        frames = tuple(Standing(p.rotation, p.translation, frame) for p in planes)
        yield Alternative("frames instead of solid squares", "", changed(frames))
    for name, words in (("aspect", "the aspect"), ("principal_point", "the principal point")):
        if name not in fixed and "focal" not in fixed:
            held = Planned(camera, planes, (*fixed, name))
            yield Alternative(f"fixing {words}, if it is known,", "", held)


class _Frame:
    kind = "frame"


def collide(planes: tuple[Standing, ...]) -> bool:
    """Whether two planes' figures would meet in the picture."""
    quads = []
    for plane in planes:
        points = plane.outlines[0] @ plane.rotation[:, :2].T + plane.translation
        quads.append(points[:, :2] / points[:, 2:])
    return any_meet(quads)


def _tilts(planes: tuple[Standing, ...]) -> tuple[float, float]:
    """Smallest and largest angle between a plane and the image plane, degrees."""
    cosines = [abs(float(plane.rotation[2, 2])) for plane in planes]
    angles = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))
    return float(angles.min()), float(angles.max())


def _tilted_more(plane: Standing, index: int, count: int) -> Standing:
    """Tilt a plane further in its own direction, or in one that differs from its neighbours'."""
    x, y, z = plane.rotation[:, 2]
    if np.hypot(x, y) < np.sin(np.radians(LEAST_TILT)) * abs(z):
        direction = 360.0 * index / count
    else:
        direction = float(np.degrees(np.arctan2(x, -y)))
    turn = tilted(MORE_TILT, direction, 0.0)
    return Standing(turn @ plane.rotation, plane.translation, plane.outlines)


def _nearer_to_corner(camera: Camera, plane: Standing) -> Standing | None:
    """Move a plane outward in the picture, at its depth; None if that is beyond the lens."""
    x, y, z = plane.translation
    size = np.array(camera.image_size)
    step = np.sign([x, y]) * NEARER * size / [camera.fx, camera.fy]
    moved = np.array([x + step[0] * z, y + step[1] * z, z])
    return Standing(plane.rotation, moved, plane.outlines)


def _further_square(
    camera: Camera, planes: tuple[Standing, ...], place: tuple[float, float]
) -> Standing | None:
    """Add a square of the others' size; its tilt's direction is away from all of theirs."""
    try:
        ideal = ideal_point(camera, np.array(place) * camera.image_size)
    except ValueError:
        return None
    depth = float(np.median([plane.translation[2] for plane in planes]))
    normals = sum((plane.rotation[:, 2] for plane in planes), np.zeros(3))
    direction = float(np.degrees(np.arctan2(-normals[0], normals[1])))
    rotation = tilted(FURTHER_TILT, direction, 45.0)
    return Standing(rotation, np.append(ideal, 1.0) * depth, (UNIT_SQUARE,))
