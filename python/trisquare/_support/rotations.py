"""Rotations of planes: checked, made from angles, and their tilt."""

from __future__ import annotations

from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray, real_array

ROTATION_TOLERANCE = 1e-6
"""A rotation written with seven digits passes, and nothing that is not one."""


def rotation_matrix(value: Any) -> FloatArray:
    """Return a rotation, shape (3, 3), as a read-only array.

    Raises
    ------
    TypeError, ValueError
        If it is none.
    """
    rotation = real_array(value, "rotation", (3, 3))
    deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if deviation > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise ValueError("rotation must be orthonormal with determinant +1")
    return rotation


def tilted(tilt: float, direction: float, spin: float) -> FloatArray:
    """Rotation of a plane turned by `spin` in itself, then tilted away from the image plane.

    The tilt's axis lies in the image plane at the angle `direction`; all in degrees.
    """
    axis = _about_z(direction)
    angle = np.radians(tilt)
    cosine, sine = np.cos(angle), np.sin(angle)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    rotation: FloatArray = axis @ about_x @ axis.T @ _about_z(spin)
    return rotation


def _about_z(degrees: float) -> FloatArray:
    angle = np.radians(degrees)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def tilt_degrees(rotation: FloatArray) -> float:
    """Angle between a plane and the image plane."""
    return float(np.degrees(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0))))
