"""Interpolated values of a picture, and points of quadrilaterals."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.images.pixels import LARGEST_RESAMPLED

GreyPicture: TypeAlias = NDArray[np.float32] | NDArray[np.uint8]


def sample(picture: GreyPicture, points: FloatArray) -> FloatArray:
    """Interpolate a picture bilinearly at points of shape (..., 2); the border is continued."""
    if points.size == 0:
        return np.zeros(points.shape[:-1])
    # OpenCV takes coordinates as a picture: each row of points is one of its rows.
    rows = points.reshape(-1, points.shape[-2], 2)
    if max(picture.shape) > LARGEST_RESAMPLED:
        values = np.concatenate([_remapped(*_around(picture, row[None])) for row in rows])
    else:
        values = _remapped(picture, rows)
    return np.asarray(values, dtype=np.float64).reshape(points.shape[:-1])


def _remapped(picture: GreyPicture, rows: FloatArray) -> NDArray[Any]:
    x, y = (np.ascontiguousarray(rows[..., axis], np.float32) for axis in (0, 1))
    return cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _around(picture: GreyPicture, rows: FloatArray) -> tuple[GreyPicture, FloatArray]:
    """Return the part of a picture that contains the points, and the points relative to it."""
    # Interpolation reads no pixel outside the part, except where its border is the picture's.
    last = np.array(picture.shape[1::-1]) - 1
    low, high = rows.min(axis=(0, 1)), rows.max(axis=(0, 1))
    left, top = np.clip(np.floor(low), 0, last).astype(int)
    right, bottom = np.clip(np.ceil(high), 0, last).astype(int) + 1
    return picture[top:bottom, left:right], rows - (left, top)


def homographies_from_unit_square(quads: FloatArray) -> FloatArray:
    """Return homographies from the unit square, clockwise from its origin, to quads (Q, 4, 2)."""
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    matrices = [cv2.getPerspectiveTransform(unit, quad.astype(np.float32)) for quad in quads]
    return np.array(matrices, dtype=np.float64).reshape(-1, 3, 3)


def straight_sides(corners: FloatArray) -> FloatArray:
    """Return the ends of the sides of quadrilaterals (Q, 4, 2), shape (Q, 4, 2, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)


def box_around(points: FloatArray) -> FloatArray:
    """Return the corners of the smallest rectangle round points, shape (4, 2)."""
    box = cv2.boxPoints(cv2.minAreaRect(points.reshape(-1, 2).astype(np.float32)))
    return np.asarray(box, dtype=np.float64)
