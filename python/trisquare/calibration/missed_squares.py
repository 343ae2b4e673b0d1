"""Which shapes that were found, but not measured, may be squares that the user meant to show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas, separated
from trisquare.camera.camera import Camera
from trisquare.detection.square_views import square_columns
from trisquare.results.calibration import Calibration
from trisquare.results.rejected import CUT_BY_BORDER, Rejected

LEAST_SHARE = 0.5
"""Area over that of the smallest plane used: smaller shapes are mostly clutter."""

MOST_OBLIQUE = 0.15
"""Cosine of the angle between a shape's sides, and logarithm of their ratio, as this camera sees
them: a square with a finger over a side has rough corners."""


def missed_squares(calibration: Calibration, shapes: Sequence[Rejected]) -> list[Rejected]:
    """Return the shapes as large as squares that were used, and which this camera sees as squares.

    Of one that the border cuts the corners are not known: it need only be large.
    """
    used = [float(quad_areas(plane.corners)) for plane in calibration.planes if plane.is_used]
    least = LEAST_SHARE * min(used, default=0.0)
    missed: list[Rejected] = []
    for shape in shapes:
        if (
            quad_areas(shape.corners) >= least
            and (shape.reason == CUT_BY_BORDER or _may_be_square(shape.corners, calibration.camera))
            and not any(_at_one_place(shape, other) for other in missed)
        ):
            missed.append(shape)
    return missed


def _at_one_place(shape: Rejected, other: Rejected) -> bool:
    """Whether the middle of a shape is within another one of the same picture."""
    middle = shape.corners.mean(axis=0)
    return shape.image == other.image and not separated(other.corners, middle[None])


def _may_be_square(corners: FloatArray, camera: Camera) -> bool:
    """Whether a camera sees a square, roughly, where these corners are, shape (4, 2)."""
    try:
        rays = camera.unproject(corners)
    except ValueError:
        return False  # beyond the lens's valid radius
    columns, ahead = square_columns(rays)
    across, down, _ = columns.T
    lengths = np.linalg.norm(across), np.linalg.norm(down)
    cosine = float(across @ down) / (lengths[0] * lengths[1])
    departure = max(abs(cosine), abs(np.log(lengths[0] / lengths[1])))
    return bool(ahead) and bool(departure < MOST_OBLIQUE)
