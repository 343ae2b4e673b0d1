"""Values of a picture between its pixels, and where quadrilaterals have their points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray


def sample(picture: NDArray[np.float32] | NDArray[np.uint8], points: FloatArray) -> FloatArray:
    """Interpolate a picture bilinearly at points of shape (..., 2); the border is continued."""
    if points.size == 0:
        return np.zeros(points.shape[:-1])
    # OpenCV maps pictures to pictures: one row of points to a row.
    rows = points.reshape(-1, points.shape[-2], 2).astype(np.float32)
    x, y = np.ascontiguousarray(rows[..., 0]), np.ascontiguousarray(rows[..., 1])
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float64).reshape(points.shape[:-1])


def homographies_from_unit_square(quads: FloatArray) -> FloatArray:
    """Homographies that map the unit square, clockwise from its origin, to quads (Q, 4, 2)."""
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    matrices = [cv2.getPerspectiveTransform(unit, quad.astype(np.float32)) for quad in quads]
    return np.array(matrices, dtype=np.float64).reshape(-1, 3, 3)


def straight_sides(corners: FloatArray) -> FloatArray:
    """Return the ends of the sides of quadrilaterals (Q, 4, 2), shape (Q, 4, 2, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
