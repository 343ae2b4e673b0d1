"""Rotations, where OpenCV's own are not worth loading it for."""

from __future__ import annotations

import math

import numpy as np

from trisquare.checked import FloatArray

SMALLEST = 1e-12
"""Radians, below which a rotation is its own linear part to rounding."""


def rotation_matrix(turn: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) of a rotation vector (3,), radians (Rodrigues)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < SMALLEST:
        return np.asarray(np.eye(3) + skew)
    sine, versine = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    return np.asarray(np.eye(3) + sine * skew + versine * skew @ skew)
