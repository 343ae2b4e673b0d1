"""Points of a plane, from where they are seen."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera, camera_for_core


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
    return _core.points_on_plane(
        camera_for_core(camera), (plane.rotation, plane.translation), pixels
    )


class StandingPlane(Protocol):
    """A plane that stands somewhere: `PlannedSquare`, `Plane`, `simulate.Target`."""

    @property
    def rotation(self) -> npt.NDArray[np.float64]:
        """Shape (3, 3)."""

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """Shape (3,), in units of the square's side."""
