"""Errors of a calibration against the camera that drew the scene."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import trisquare as ts
from trisquare.simulate.scene import TrueCamera

Array = npt.NDArray[np.float64]

PINHOLE = ("fx", "fy", "cx", "cy")
NAMES = (*PINHOLE, "k1", "k2")


def camera_vector(K: Array, distortion: Array) -> Array:
    """Return fx, fy, cx, cy, k1, k2, shape (6,)."""
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion[:2]])


def errors(result: ts.Calibration, truth: TrueCamera) -> Array:
    """Return estimate minus truth in the order of `NAMES`, shape (6,)."""
    estimate = camera_vector(result.camera.K, result.camera.distortion)
    return estimate - camera_vector(truth.K, truth.distortion)


def by_name(deviations: Mapping[str, float]) -> Array:
    """Return standard deviations in the order of `NAMES`, shape (6,)."""
    return np.array([deviations[name] for name in NAMES])


def rms(values: Array) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


MAD_TO_STD = 1.4826
"""Standard deviation over the median absolute deviation, of a normal distribution."""


def robust_spread(values: Array) -> float:
    """Return the standard deviation estimated from the median absolute deviation."""
    return MAD_TO_STD * float(np.median(np.abs(values - np.median(values))))


def rms_per_parameter(values: Array) -> str:
    """Return the root mean square of each column of shape (N, 6), with its name."""
    columns = np.sqrt(np.mean(values**2, axis=0))
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(NAMES, columns, strict=True))
