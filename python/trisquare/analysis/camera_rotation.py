"""Two cameras that look the same way: the pixels of one in the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera, camera_for_core

MOST_STEPS = 20
"""Gauss-Newton steps for the rotation; from the start that is used, 3 or 4 do."""

ROTATION_STEP = 1e-6
"""Radians for derivatives by differences, right to six digits; a thousandth of a pixel."""

PIXEL_STEP = 1e-2
"""Pixels, likewise."""

LEAST_IN_COMMON = 0.1
"""Part of the picture that both cameras must be able to follow for a comparison to mean much."""

CONVERGED = 1e-12
"""Radians: no picture shows a smaller turn."""


@dataclass(frozen=True, slots=True)
class TurnedCameras:
    """One camera's pixels in another that is turned against it."""

    first: Camera
    second: Camera
    rotation: FloatArray

    def by(self, turn: FloatArray) -> TurnedCameras:
        """Return the same after a further small turn, a rotation vector in radians."""
        return TurnedCameras(self.first, self.second, rotation_matrix(turn) @ self.rotation)

    def sees(self, pixels: FloatArray) -> FloatArray:
        """Tell which of the pixels both cameras can follow, shape (N,) of bool."""
        seen = np.array(_core.can_unproject(camera_for_core(self.first), pixels), dtype=bool)
        rays = self.first.unproject(pixels[seen]) @ self.rotation.T
        seen[seen] = self.second.can_project(rays)
        return np.asarray(seen)

    def project(self, pixels: FloatArray) -> FloatArray:
        """Return where the second camera sees what the first sees at pixels."""
        return self.second.project(self.first.unproject(pixels) @ self.rotation.T)

    def by_turn(self, pixels: FloatArray) -> FloatArray:
        """Return the derivative of `project` by a further turn, shape (N, 2, 3)."""
        steps = ROTATION_STEP * np.eye(3)
        moved = [self.by(step).project(pixels) - self.by(-step).project(pixels) for step in steps]
        return np.stack(moved, axis=-1) / (2 * ROTATION_STEP)

    def by_pixel(self, pixels: FloatArray) -> FloatArray:
        """Return the derivative of `project` by the pixel, shape (N, 2, 2)."""
        steps = PIXEL_STEP * np.eye(2)
        moved = [self.project(pixels + step) - self.project(pixels - step) for step in steps]
        return np.stack(moved, axis=-1) / (2 * PIXEL_STEP)


def best_turn(first: Camera, second: Camera, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find the turn with the least squared distances, and which pixels (N,) it leaves in sight."""
    turned = TurnedCameras(first, second, np.eye(3))
    seen = _in_sight(turned, pixels)
    for _ in range(MOST_STEPS):
        jacobian = turned.by_turn(pixels[seen]).reshape(-1, 3)
        difference = (turned.project(pixels[seen]) - pixels[seen]).ravel()
        step = np.linalg.lstsq(jacobian, -difference, rcond=None)[0]
        turned = turned.by(step)
        seen = _in_sight(turned, pixels)
        if float(np.linalg.norm(step)) < CONVERGED:
            break
    return turned.rotation, seen


def _in_sight(turned: TurnedCameras, pixels: FloatArray) -> FloatArray:
    """Which pixels (N,) can be followed, with as much room around as the derivatives take."""
    focal = max(turned.first.fx, turned.first.fy)
    room = 2 * max(PIXEL_STEP, ROTATION_STEP * focal)
    corners = [(dx, dy) for dx in (-room, room) for dy in (-room, room)]
    seen = np.all([turned.sees(pixels + corner) for corner in corners], axis=0)
    if seen.mean() < LEAST_IN_COMMON:
        raise ValueError(
            "the cameras have too little in common: their distortions can be inverted together "
            f"over {100 * seen.mean():.0f} % of the picture"
        )
    return np.asarray(seen)


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
