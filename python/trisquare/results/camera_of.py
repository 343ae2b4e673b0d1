"""A camera that is known: with its uncertainty, or as if it were exact."""

from __future__ import annotations

from trisquare.camera.camera import Camera
from trisquare.results.calibration import Calibration


def camera_of(camera: Calibration | Camera, name: str = "camera") -> Camera:
    """Return the camera itself, of a calibration its estimate.

    Raises
    ------
    TypeError
        If it is neither; the message calls it `name`.
    """
    if isinstance(camera, Calibration):
        return camera.camera
    if isinstance(camera, Camera):
        return camera
    raise TypeError(f"{name} must be a Calibration or a Camera, not {type(camera).__name__}")
