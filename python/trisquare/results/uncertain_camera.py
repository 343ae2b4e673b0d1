"""A camera with its uncertainty for the compiled core; one without uncertainty counts as exact."""

from __future__ import annotations

from trisquare.camera.camera import Camera
from trisquare.camera.projection_uncertainty import UncertainCamera, uncertain
from trisquare.results.calibration import Calibration


def uncertain_camera(camera: Calibration | Camera) -> UncertainCamera:
    """Return a camera with its uncertainty for the compiled core; a `Camera` has none."""
    if isinstance(camera, Camera):
        return uncertain(camera)
    return uncertain(camera.camera, camera.parameters, camera.fixed, camera.covariance)
