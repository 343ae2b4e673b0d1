"""Values of a picture between its pixels, and where quadrilaterals have their points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

LARGEST_REMAPPED = 32766
"""Pixels of a side, of what ``cv2.remap`` takes."""


def sample(
    picture: NDArray[np.float32] | NDArray[np.uint8],
    points: FloatArray,
    *,
    is_part: bool = False,
) -> FloatArray:
    """Interpolate a picture bilinearly at points of shape (..., 2); the border is continued."""
    if points.size == 0:
        return np.zeros(points.shape[:-1])
    # OpenCV maps pictures to pictures: one row of points to a row.
    rows = points.reshape(-1, points.shape[-2], 2)
    if max(picture.shape) > LARGEST_REMAPPED and not is_part:
        of_rows = [sample(*_around(picture, row), is_part=True) for row in rows]
        return np.array(of_rows).reshape(points.shape[:-1])
    rows = rows.astype(np.float32)
    x, y = np.ascontiguousarray(rows[..., 0]), np.ascontiguousarray(rows[..., 1])
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float64).reshape(points.shape[:-1])


def _around(
    picture: NDArray[np.float32] | NDArray[np.uint8], points: FloatArray
) -> tuple[NDArray[np.float32] | NDArray[np.uint8], FloatArray]:
    """Return the part of a picture that holds the points, and them in it."""
    # A pixel beside the part is not looked at: there the border is that of the picture.
    last = np.array(picture.shape[1::-1]) - 1
    places = points.reshape(-1, 2)
    first = np.clip(np.floor(places.min(axis=0)), 0, last).astype(int)
    beyond = np.clip(np.ceil(places.max(axis=0)), 0, last).astype(int) + 1
    part = picture[first[1] : beyond[1], first[0] : beyond[0]]
    return part, points - first


def homographies_from_unit_square(quads: FloatArray) -> FloatArray:
    """Homographies that map the unit square, clockwise from its origin, to quads (Q, 4, 2)."""
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    matrices = [cv2.getPerspectiveTransform(unit, quad.astype(np.float32)) for quad in quads]
    return np.array(matrices, dtype=np.float64).reshape(-1, 3, 3)


def straight_sides(corners: FloatArray) -> FloatArray:
    """Return the ends of the sides of quadrilaterals (Q, 4, 2), shape (Q, 4, 2, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
