"""Shapes that were found but not measured, and may be squares that the user meant to show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas, separated
from trisquare.camera.camera import Camera
from trisquare.detection.candidates import SQUARES_NEEDED
from trisquare.detection.square_views import square_columns
from trisquare.results.calibration import Calibration
from trisquare.results.rejected import CUT_BY_BORDER, Rejected

MIN_SHARE = 0.5
"""Minimum area, as a fraction of that of the smallest plane used: smaller shapes are mostly
clutter."""

MAX_OBLIQUE = 0.15
"""Maximum cosine of the angle between a shape's sides, and maximum logarithm of their ratio, as
this camera sees them: a square with a finger over a side has inexact corners."""

MIN_CUT_SHARE, MAX_OBLIQUE_BY_FEW = 0.35, 0.6
"""The same limits if fewer squares are used than a calibration needs: half of a square may be cut
off by the border, glare over a corner moves it by a fifth of a side, and the camera is less well
known."""


def has_few_squares(calibration: Calibration) -> bool:
    """Return whether fewer plain squares are used than a calibration needs, and nothing else is."""
    used = [plane.kind for plane in calibration.planes if plane.is_used]
    return len(used) < SQUARES_NEEDED and set(used) <= {"square", "frame"}


def missed_squares(calibration: Calibration, shapes: Sequence[Rejected]) -> list[Rejected]:
    """Return the shapes about as large as the used squares which this camera sees as squares.

    The corners of a shape that the border cuts are unknown: it only needs to be large. A shape
    around another one is the sheet that it is on.
    """
    used = [float(quad_areas(plane.corners)) for plane in calibration.planes if plane.is_used]
    smallest = min(used, default=0.0)
    min_cut_share, max_obliqueness = MIN_SHARE, MAX_OBLIQUE
    if len(used) < SQUARES_NEEDED:
        min_cut_share, max_obliqueness = MIN_CUT_SHARE, MAX_OBLIQUE_BY_FEW
    missed: list[Rejected] = []
    for shape in sorted(shapes, key=lambda shape: shape.reason == CUT_BY_BORDER):
        is_cut = shape.reason == CUT_BY_BORDER
        if (
            quad_areas(shape.corners) >= (min_cut_share if is_cut else MIN_SHARE) * smallest
            and (is_cut or _may_be_square(shape.corners, calibration.camera, max_obliqueness))
            and not any(
                _contains_centre(shape, other) or _contains_centre(other, shape)
                for other in (*missed, *calibration.rejected)
            )
        ):
            missed.append(shape)
    return missed


def _contains_centre(shape: Rejected, other: Rejected) -> bool:
    """Return whether the centre of another shape of the same picture is within a shape."""
    middle = other.corners.mean(axis=0)
    return shape.image == other.image and not separated(shape.corners, middle[None])


def _may_be_square(corners: FloatArray, camera: Camera, max_obliqueness: float) -> bool:
    """Return whether corners, shape (4, 2), are roughly those of a square for this camera."""
    try:
        rays = camera.unproject(corners)
    except ValueError:
        return False  # beyond the lens's valid radius
    columns, is_ahead = square_columns(rays)
    across, down, _ = columns.T
    lengths = np.linalg.norm(across), np.linalg.norm(down)
    cosine = float(across @ down) / (lengths[0] * lengths[1])
    departure = max(abs(cosine), abs(np.log(lengths[0] / lengths[1])))
    return bool(is_ahead) and bool(departure < max_obliqueness)
