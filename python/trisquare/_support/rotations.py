"""Rotations of planes: checks, conversion from angles, and tilt."""

from __future__ import annotations

from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray, real_array

ROTATION_TOLERANCE = 1e-6
"""Maximum error of orthonormality: rotations written with seven digits pass."""


def rotation_matrix(value: Any) -> FloatArray:
    """Return a rotation, shape (3, 3), as a read-only array.

    Raises
    ------
    TypeError, ValueError
        If it is not a rotation.
    """
    rotation = real_array(value, "rotation", (3, 3))
    # The third row of a rotation is the cross product of the others.
    (a, b, c), (d, e, f), third = rotation.tolist()
    expected = (b * f - c * e, c * d - a * f, a * e - b * d)
    errors = [
        product - expected_product
        for product, expected_product in zip(third, expected, strict=True)
    ]
    errors += [a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, a * d + b * e + c * f]
    if not all(abs(error) <= ROTATION_TOLERANCE for error in errors):
        raise ValueError("rotation must be orthonormal with determinant +1")
    return rotation


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return the axis of a rotation times its angle, shape (3,), radians from 0 to pi.

    It is computed from the unit quaternion, whose largest member comes from the diagonal, which is
    exact near 0 and near pi (Shepperd, Journal of Guidance and Control 1 (1978) 223-224).
    """
    r = rotation
    trace = np.trace(r)
    squares = np.array([trace, *np.diag(r)])
    which = int(np.argmax(squares))
    if which == 0:
        axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        scalar = 1.0 + trace
    else:
        i, j, k = np.roll(np.arange(3), 1 - which)
        axis = np.empty(3)
        axis[i] = 1.0 + 2.0 * r[i, i] - trace
        axis[j], axis[k] = r[j, i] + r[i, j], r[k, i] + r[i, k]
        scalar = r[k, j] - r[j, k]
        if scalar < 0:
            axis, scalar = -axis, -scalar
    length = float(np.linalg.norm(axis))
    angle = 2.0 * np.arctan2(length, scalar)
    vector: FloatArray = axis * (angle / length) if length > 0 else np.zeros(3)
    return vector


def tilted(tilt: float, direction: float, spin: float) -> FloatArray:
    """Return the rotation of a plane turned by `spin` in itself, then tilted by `tilt`.

    The axis of the tilt is in the image plane at the angle `direction`; all are in degrees.
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
    """Return the angle between a plane and the image plane, degrees."""
    return float(np.degrees(np.arccos(np.clip(rotation[2, 2], -1.0, 1.0))))
