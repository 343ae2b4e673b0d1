"""A camera for the compiled core with its uncertainty, or as if it were exact."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera, CoreCamera, camera_for_core
from trisquare.results.calibration import Calibration

# Its free parameters, whether fy follows fx, and the parameters' covariance.
UncertainCamera: TypeAlias = "tuple[CoreCamera, list[str], bool, FloatArray]"


def uncertain_camera(camera: Calibration | Camera) -> UncertainCamera:
    """Return a camera with its uncertainty for the compiled core; a `Camera` has none."""
    if isinstance(camera, Camera):
        return camera_for_core(camera), [], False, np.zeros((0, 0))
    aspect_fixed = "aspect" in camera.fixed
    lens = camera_for_core(camera.camera)
    return lens, list(camera.parameters), aspect_fixed, camera.covariance
