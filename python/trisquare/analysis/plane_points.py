"""Points of a plane, from where they are seen."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera

GRAZING = 1e-3
"""Cosine of the angle between ray and normal below which a point's place means nothing."""


def onto_plane(pixels: FloatArray, camera: Camera, plane: StandingPlane) -> FloatArray:
    """Intersect the rays of pixels with a plane.

    Parameters
    ----------
    pixels : ndarray, shape (N, 2)
        In the photograph.
    camera : Camera
        That took it.
    plane : StandingPlane
        ``X_cam = rotation @ X_plane + translation``.

    Returns
    -------
    ndarray, shape (N, 2)
        In the plane's own coordinates and unit.

    Raises
    ------
    ValueError
        If a pixel lies beyond the valid radius, or at or beyond the plane's horizon.
    """
    rays = camera.unproject(pixels)
    normal = plane.rotation[:, 2]
    distance = float(normal @ plane.translation)
    towards = rays @ normal
    # A ray meets the plane ahead of the camera if it leaves to the plane's side.
    met = np.sign(distance) * towards > GRAZING
    if not met.all():
        index = int(np.argmin(met))
        x, y = pixels[index]
        raise ValueError(f"point {index}, ({x:g}, {y:g}), is at or beyond the plane's horizon")
    points = rays * (distance / towards)[:, None] - plane.translation
    return np.asarray((points @ plane.rotation)[:, :2])


class StandingPlane(Protocol):
    """A plane that stands somewhere: `PlannedSquare`, `Plane`, `simulate.Target`."""

    @property
    def rotation(self) -> npt.NDArray[np.float64]:
        """Shape (3, 3)."""

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """Shape (3,), in units of the square's side."""
