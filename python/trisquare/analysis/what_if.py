"""Predicted standard deviations after one change: planes tilted, closer or added."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import any_meet
from trisquare._support.rotations import tilted
from trisquare.analysis.plan import (
    OUTLINED,
    UNIT_SQUARE,
    PosedPlane,
    onto_plane,
    outlines_of,
    posed,
    predicted,
    ray_at,
)
from trisquare.camera.camera import Camera
from trisquare.camera.settings import FREEABLE
from trisquare.errors import TrisquareError
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

MORE_TILT = 10.0  # degrees
# Range of angles (degrees) between tilts that are small and the maximum tilt that is advised.
ENOUGH_TILT = (25.0, 50.0)
ENLARGEMENT = 1.25
# Side of a figure, as a fraction of the picture's height, above which it is large enough
# (docs/photograph.md).
ENOUGH_SPAN = 1.0 / 3.0
CORNER_STEP = 0.1  # displacement, as a fraction of the picture's size
# Tilt (degrees) below which a plane has no definite direction of tilt.
MIN_TILT = 1.0
ADDED_TILT = 35.0  # degrees, of an added square
# Positions of an added square, as fractions of the picture's width and height.
ADDED_PLACES = {
    "upper left": (0.25, 0.25),
    "upper right": (0.75, 0.25),
    "lower left": (0.25, 0.75),
    "lower right": (0.75, 0.75),
}
# Deviation, in standard deviations, from the usual value of cameras, above which an estimate
# contradicts that value.
CONTRADICTING = 3.0


class WhatIf(NamedTuple):
    """A change of the set-up, as a noun phrase, and the deficiency that it removes, if any."""

    change: str
    lack: str
    planes: tuple[PosedPlane, ...]
    fixed: tuple[str, ...]


def gains(calibration: Calibration) -> list[tuple[WhatIf, Mapping[str, float]]]:
    """Return the ratios of predicted standard deviations after and before each change."""
    camera = calibration.camera
    free = [name for name in FREEABLE if name in calibration.parameters]
    try:
        planes = planes_of(calibration)
        before = predicted(camera, planes, calibration.fixed, free=free).std
        # Planes of several pictures may overlap in the image plane.
        is_separate = not _collide(camera, planes)
    except (TrisquareError, ValueError):
        return []  # the photographed planes allow no prediction to compare with
    ratios: list[tuple[WhatIf, Mapping[str, float]]] = []
    for what_if in changes_of(calibration, planes):
        # A change that moves a plane out of the picture is skipped.
        with suppress(TrisquareError, ValueError):
            if is_separate and _collide(camera, what_if.planes):
                continue
            after = predicted(camera, what_if.planes, what_if.fixed, free=free).std
            ratios.append((what_if, {name: after[name] / before[name] for name in after}))
    return ratios


def planes_of(calibration: Calibration) -> tuple[PosedPlane, ...]:
    """Return the planes that are used; a lattice as the rectangle of its outermost corners."""
    return tuple(
        posed(plane)
        if plane.kind in OUTLINED
        else PosedPlane(
            plane.rotation,
            plane.translation,
            [onto_plane(plane.corners, calibration.camera, plane)],
        )
        for plane in _used(calibration).values()
    )


def _used(calibration: Calibration) -> dict[int, Plane]:
    """Return the planes that the camera is estimated from, by index."""
    return {index: plane for index, plane in enumerate(calibration.planes) if plane.is_used}


def changes_of(calibration: Calibration, planes: tuple[PosedPlane, ...]) -> Iterator[WhatIf]:
    """Yield the changed set-ups to compare with the photographed one."""
    camera, fixed = calibration.camera, calibration.fixed
    cosines = np.abs([plane.rotation[2, 2] for plane in planes])
    tilts = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))
    if tilts.max() + MORE_TILT <= ENOUGH_TILT[1]:
        tilt_text = f"the squares are tilted by only {_range_text(tilts)} degrees"
        yield WhatIf(
            f"tilting every square {MORE_TILT:g} degrees more",
            tilt_text if tilts.min() < ENOUGH_TILT[0] else "",
            tuple(
                _tilted_further(plane, 360.0 * i / len(planes)) for i, plane in enumerate(planes)
            ),
            fixed,
        )
    yield WhatIf(
        f"showing the squares {ENLARGEMENT:g} times larger",
        _size_text(calibration),
        tuple(plane._replace(translation=plane.translation / ENLARGEMENT) for plane in planes),
        fixed,
    )
    for index, (number, plane) in enumerate(zip(_used(calibration), planes, strict=True)):
        x, y, z = plane.translation
        dx, dy = np.sign([x, y]) * CORNER_STEP * camera.image_size / [camera.fx, camera.fy]
        moved = plane._replace(translation=np.array([x + dx * z, y + dy * z, z]))
        yield WhatIf(
            f"moving plane {number} nearer to the corner of the picture",
            "the squares leave the picture's corners empty",
            (*planes[:index], moved, *planes[index + 1 :]),
            fixed,
        )
    for position, place in ADDED_PLACES.items():
        try:
            ray = ray_at(camera, np.multiply(place, camera.image_size))
        except ValueError:
            continue
        yield WhatIf(
            f"adding a square in the picture's {position}, tilted in another direction,",
            "there are few squares",
            (*planes, _added_square(planes, ray)),
            fixed,
        )
    if all(plane.kind in ("square", "tag") for plane in _used(calibration).values()):
        frames = tuple(plane._replace(outlines=outlines_of("frame")) for plane in planes)
        yield WhatIf("frames instead of solid squares", "", frames, fixed)
    for name, description in _fixable_parameters(calibration).items():
        if name not in fixed and "focal" not in fixed:
            yield WhatIf(f"fixing {description}", "", planes, (*fixed, name))


def _size_text(calibration: Calibration) -> str:
    """Return a description of the size of the squares in the picture, if it is small."""
    corners = [plane.corners for plane in _used(calibration).values()]
    sides = [np.roll(quad, -1, axis=0) - quad for quad in corners]
    spans = np.array([np.linalg.norm(quad_sides, axis=1).max() for quad_sides in sides])
    shares = spans / calibration.camera.image_size[1]
    if shares.max() >= ENOUGH_SPAN:
        return ""
    return (
        f"the sides of the squares span only {_range_text(100 * shares)} % of the picture's height"
    )


def _range_text(values: FloatArray) -> str:
    low, high = f"{values.min():.0f}", f"{values.max():.0f}"
    return low if low == high else f"{low} to {high}"


def _fixable_parameters(calibration: Calibration) -> dict[str, str]:
    """Return what may be fixed, with its description, unless the estimate contradicts it."""
    camera, known = calibration.camera, {}
    if contradicted_aspect(calibration) is None:
        known["aspect"] = "the aspect, since nearly every camera's pixels are square,"
    offset = np.array([camera.cx, camera.cy]) - np.subtract(camera.image_size, 1) / 2.0
    covariance = _sub_covariance(calibration, "cx", "cy")
    is_central = (
        covariance is None or offset @ np.linalg.pinv(covariance) @ offset < CONTRADICTING**2
    )
    source = "" if is_central else " from another source, since it is not the picture's centre"
    known["principal_point"] = f"the principal point, if it is known{source},"
    return known


def contradicted_aspect(calibration: Calibration) -> tuple[float, float] | None:
    """Return ``fy / fx`` and its standard deviation if they contradict square pixels."""
    covariance = _sub_covariance(calibration, "fx", "fy")
    if covariance is None:
        return None
    ratio = calibration.camera.fy / calibration.camera.fx
    slope = np.array([-ratio, 1.0]) / calibration.camera.fx
    std = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
    return (ratio, std) if abs(ratio - 1.0) > CONTRADICTING * std else None


def _sub_covariance(calibration: Calibration, *names: str) -> FloatArray | None:
    """Return the covariance of some parameters; None unless all of them are free."""
    if not set(names) <= set(calibration.parameters):
        return None
    places = [calibration.parameters.index(name) for name in names]
    return calibration.covariance[np.ix_(places, places)]


def _collide(camera: Camera, planes: tuple[PosedPlane, ...]) -> bool:
    """Return whether outlines of two planes meet in the picture.

    Raises
    ------
    ValueError
        If an outline is beyond the valid radius.
    """
    points = [plane.outlines[0] @ plane.rotation[:, :2].T + plane.translation for plane in planes]
    return any_meet([camera.project(corners) for corners in points])


def _tilted_further(plane: PosedPlane, direction: float) -> PosedPlane:
    """Tilt a plane further in its own direction or, if it has none, in the given one."""
    x, y, z = plane.rotation[:, 2]
    if np.hypot(x, y) >= np.sin(np.radians(MIN_TILT)) * abs(z):
        direction = float(np.degrees(np.arctan2(x, -y)))
    return plane._replace(rotation=tilted(MORE_TILT, direction, 0.0) @ plane.rotation)


def _added_square(planes: tuple[PosedPlane, ...], ray: FloatArray) -> PosedPlane:
    """Add a square of the others' size, tilted away from the mean direction of their tilts."""
    depth = float(np.median([plane.translation[2] for plane in planes]))
    normals = sum((plane.rotation[:, 2] for plane in planes), np.zeros(3))
    direction = float(np.degrees(np.arctan2(-normals[0], normals[1])))
    rotation = tilted(ADDED_TILT, direction, 45.0)
    return PosedPlane(rotation, ray * depth, [UNIT_SQUARE])
