"""The grey picture that is searched."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

RANGE_PERCENTILES = (0.5, 99.5)
"""Percentiles of the grey levels that bound the range, without the darkest and brightest specks."""

MIN_PICTURE = 32
"""Side in pixels below which a picture cannot contain a square with its ground."""

WORKING_SIZE = 1000
"""Maximum longer side, in pixels, of the picture that is searched: larger ones are halved, which
saves three quarters of the work, removes most of the noise and keeps outlines accurate to a
pixel."""

RELIABLE_SIDE = 15
"""Side, in pixels of the picture that is searched, from which a square is found at any rotation: a
little above the minimum side of an outline."""

RANGE_PIXELS = 4_000_000
"""Maximum number of pixels from which the range of a picture of more than 8 bits is computed: so
many determine two percentiles to a hundredth of a percent."""

STRIP_ROWS = 256
"""Number of rows stretched to 8 bits at a time, so that a large picture is not copied as floats."""


def grey_bytes(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return a grey picture of 8 bits, stretched to its own range if it had more; for detection."""
    return grey_bytes_and_range(image)[0]


def grey_bytes_and_range(
    image: NDArray[np.generic],
) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Return `grey_bytes` and the levels at its 0 and 255, white being 255."""
    if image.size == 0:
        return np.zeros(image.shape[:2], dtype=np.uint8), (0.0, 0.0)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(_grey(image), dtype=np.uint8), (0.0, 255.0)
    step = 1 + int(np.sqrt(image.shape[0] * image.shape[1] / RANGE_PIXELS))
    pixels = np.asarray(_grey(image[::step, ::step]), dtype=np.float32)
    darkest, brightest = map(float, np.percentile(pixels, RANGE_PERCENTILES))
    scale = 255.0 / (65535.0 if image.dtype == np.uint16 else 1.0)
    levels = (scale * darkest, scale * brightest)
    stretched = np.zeros(image.shape[:2], dtype=np.uint8)
    if not brightest > darkest:
        return stretched, levels
    for top in range(0, len(image), STRIP_ROWS):
        rows = slice(top, top + STRIP_ROWS)
        values = np.asarray(_grey(image[rows]), dtype=np.float32)
        values = np.rint((values - darkest) * (255.0 / (brightest - darkest)))
        stretched[rows] = np.clip(values, 0.0, 255.0)
    return stretched, levels


def _grey(image: NDArray[np.generic]) -> NDArray[np.generic]:
    if image.ndim == 2:
        return image
    contiguous = np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(contiguous, cv2.COLOR_BGR2GRAY))


def working_scale(size: tuple[int, ...]) -> int:
    """Return the pixels of a photograph per pixel of the picture that is searched, along a side."""
    longest, shortest, scale = max(size), min(size), 1
    while longest > WORKING_SIZE and shortest >= MIN_PICTURE:
        longest, shortest, scale = (longest + 1) // 2, (shortest + 1) // 2, 2 * scale
    return scale


def working_picture(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """Return a smooth picture of moderate size, and the photograph's pixels per pixel of it."""
    scale = working_scale(grey.shape)
    for _ in range(scale.bit_length() - 1):
        grey = np.asarray(cv2.pyrDown(grey), dtype=np.uint8)
    if scale == 1 and min(grey.shape) >= MIN_PICTURE:
        grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0.0), dtype=np.uint8)
    return grey, scale
