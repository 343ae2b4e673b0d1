"""A calibration for its pictures in another resolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trisquare.camera import Camera
from trisquare.result import Calibration

# The name of each parameter that is in pixels, and its axis.
IN_PIXELS = {"fx": 0, "fy": 1, "cx": 0, "cy": 1}


def rescaled(camera: Calibration | Camera, image_size: tuple[int, int]) -> Calibration | Camera:
    """Scale a camera, with its covariance if there is one, by the rule of `Camera.rescaled`.

    The planes and what else belongs to the pictures of the other size are left behind.

    Raises
    ------
    TypeError, ValueError
        As `Camera.rescaled`.
    """
    if isinstance(camera, Camera):
        return camera.rescaled(image_size)
    scaled = camera.camera.rescaled(image_size)
    ratios = np.divide(scaled.image_size, camera.camera.image_size)
    by_name = {name: float(ratios[axis]) for name, axis in IN_PIXELS.items()}
    factors = np.array([by_name.get(name, 1.0) for name in camera.parameters])
    return replace(
        camera,
        camera=scaled,
        covariance=factors[:, None] * camera.covariance * factors,
        std={name: by_name.get(name, 1.0) * std for name, std in camera.std.items()},
        rms=camera.rms * float(np.sqrt(np.prod(ratios))),
        planes=(),
        rejected=(),
        alternatives=(),
        coherence=None,
    )
