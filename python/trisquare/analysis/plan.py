"""Squares that are to be photographed: where they will stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray, RebuiltByConstructor, real_array, real_number
from trisquare.camera.camera import Camera

# A rotation survives being written with seven digits, and nothing that is not one passes.
ROTATION_TOLERANCE = 1e-6

UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

# Newton on the distortion converges quadratically; a pixel inside the valid radius needs few steps.
UNDISTORT_STEPS = 50
UNDISTORT_TOLERANCE = 1e-10  # normalised; a millionth of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSquare(RebuiltByConstructor):
    """A square that is to be photographed.

    Parameters
    ----------
    rotation, translation : array_like, shape (3, 3) and (3,)
        ``X_cam = rotation @ X_plane + translation``, in units of the square's side; the plane's
        origin is the square's centre and its Z axis points away from the camera.
    inner : float, optional
        Side of the square hole that makes it a frame, in units of its own side.

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type or shape, or is no rotation or no hole.
    """

    rotation: FloatArray
    translation: FloatArray
    inner: float | None = None

    def __post_init__(self) -> None:
        rotation = real_array(self.rotation, "rotation", (3, 3))
        deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if deviation > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise ValueError("rotation must be orthonormal with determinant +1")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", real_array(self.translation, "translation", (3,)))
        if self.inner is not None:
            inner = real_number(self.inner, "inner")
            if not 0.0 < inner < 1.0:
                raise ValueError(f"inner must be between 0 and 1, not {inner}")
            object.__setattr__(self, "inner", inner)

    @classmethod
    def at(
        cls,
        camera: Camera,
        centre: tuple[float, float],
        side: float,
        *,
        tilt: float,
        direction: float,
        spin: float = 0.0,
        inner: float | None = None,
    ) -> PlannedSquare:
        """Place a square by what it will look like.

        Parameters
        ----------
        camera : Camera
            The camera, or a guess.
        centre : (float, float)
            Where its centre will be seen, pixels.
        side : float
            How long its side would be seen if it faced the camera, pixels.
        tilt : float
            Angle between its plane and the image plane, degrees.
        direction : float
            Angle of the axis that it is tilted about, in the image plane from x toward y,
            degrees: at 0 its upper edge leans toward the camera, at 90 its right one does.
        spin : float
            Angle by which it is turned in its own plane beforehand, degrees.
        inner : float, optional
            Makes it a frame, see the class.

        Raises
        ------
        ValueError
            If the centre lies where the camera's distortion is not invertible, or the side is
            not positive.
        """
        if not isinstance(camera, Camera):
            raise TypeError(f"camera must be a Camera, not {type(camera).__name__}")
        length = real_number(side, "side")
        if length <= 0.0:
            raise ValueError(f"side must be positive, not {length}")
        angles = [real_number(angle, "an angle") for angle in (tilt, direction, spin)]
        ray = np.append(ideal_point(camera, real_array(centre, "centre", (2,))), 1.0)
        return cls(tilted(*angles), ray * (camera.fx / length), inner)

    def __repr__(self) -> str:
        x, y, z = self.translation.tolist()
        tilt = np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0)))
        name = "PlannedSquare" if self.inner is None else f"PlannedSquare (hole {self.inner:g})"
        return f"<{name} at ({x:.4g}, {y:.4g}, {z:.4g}), tilted {tilt:.1f} degrees>"


def tilted(tilt: float, direction: float, spin: float) -> FloatArray:
    """Rotation of a plane spun in itself, then tilted about an axis of the image plane; degrees."""
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


def ideal_point(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Follow a pixel back to its ideal normalised point, shape (2,), by Newton's method.

    Raises
    ------
    ValueError
        If the distortion is not invertible there.
    """
    observed = (pixel - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    ideal = observed.copy()
    limit = np.inf if camera.valid_radius is None else camera.valid_radius
    for _ in range(UNDISTORT_STEPS):
        if not np.linalg.norm(ideal) <= limit:
            break
        distorted, jacobian = _distort(camera.distortion, ideal)
        step = np.linalg.solve(jacobian, observed - distorted)
        ideal = ideal + step
        if np.linalg.norm(step) < UNDISTORT_TOLERANCE and np.linalg.norm(ideal) <= limit:
            return ideal
    raise ValueError(f"the camera's distortion is not invertible at the pixel {pixel.tolist()}")


def _distort(distortion: FloatArray, ideal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Brown's distortion of one point, and its Jacobian."""
    k1, k2, p1, p2, k3 = distortion.tolist()
    x, y = ideal.tolist()
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
    cross = slope * x * y + 2.0 * (p1 * x + p2 * y)
    point = [
        x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
        y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
    ]
    jacobian = [
        [radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, cross],
        [cross, radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x],
    ]
    return np.array(point), np.array(jacobian)


def outlines_of(plane: Any) -> list[FloatArray]:
    """Corners, each of shape (4, 2) in plane units, of the figures on a square or frame.

    A frame whose hole is not known is taken to have one of 0.6 of its side.

    Raises
    ------
    ValueError
        If the plane shows neither a square nor a frame.
    """
    inner = getattr(plane, "inner", None)
    kind = getattr(plane, "kind", "square" if inner is None else "frame")
    if kind not in ("square", "tag", "frame"):
        raise ValueError(f"a prediction needs squares, tags or frames, not a {kind}")
    if kind != "frame":
        return [UNIT_SQUARE]
    return [UNIT_SQUARE, UNIT_SQUARE * (0.6 if inner is None else real_number(inner, "inner"))]
