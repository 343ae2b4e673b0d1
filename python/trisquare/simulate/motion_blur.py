"""Blur from a straight, uniform motion of the camera while the shutter is open."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trisquare.simulate.scene import Array

POINTS_PER_PIXEL = 16
"""Number of points per pixel of the path's length: steps far below a pixel."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A path of the picture over the sensor during the exposure.

    Across an edge its blur is a box as wide as the path's extent in that direction: its standard
    deviation is ``length / sqrt(12)`` for an edge across the path, and zero for one along it. Light
    is spread evenly to both sides, so that no edge moves.

    Attributes
    ----------
    length : float
        Pixels, not negative.
    direction : float
        Degrees, from the x axis towards the y axis (down).
    """

    length: float
    direction: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.length < np.inf and np.isfinite(self.direction)):
            raise ValueError(
                f"a motion needs a length of 0 or more and a direction, got {self.length} px "
                f"and {self.direction} degrees"
            )

    def blurred(self, light: Array) -> Array:
        """Spread linear light (H, W, channels) along the path; the border's light is continued."""
        if self.length == 0.0:
            return light
        spread = cv2.filter2D(light, -1, self.kernel(), borderType=cv2.BORDER_REPLICATE)
        return np.asarray(spread, dtype=np.float64).reshape(light.shape)

    def kernel(self) -> Array:
        """Return the fraction of the light on each pixel, shape (2 N + 1, 2 N + 1).

        The middle is that of the path. Points between pixels are distributed bilinearly, which
        keeps the path's centre but adds a variance of up to 1/6 square pixel along each axis.
        """
        count = max(int(POINTS_PER_PIXEL * self.length), 1)
        along = self.length * ((np.arange(count) + 0.5) / count - 0.5)
        angle = np.deg2rad(self.direction)
        x, y = along * np.cos(angle), along * np.sin(angle)
        reach = int(np.ceil(0.5 * self.length)) + 1
        pixels = np.arange(-reach, reach + 1)
        share_x = np.clip(1.0 - np.abs(x[:, None] - pixels), 0.0, None)
        share_y = np.clip(1.0 - np.abs(y[:, None] - pixels), 0.0, None)
        return np.asarray(share_y.T @ share_x / count)
