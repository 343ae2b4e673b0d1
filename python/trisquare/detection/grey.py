"""The grey picture that is searched."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

RANGE_PERCENTILES = (0.5, 99.5)
"""The range leaves out the darkest and brightest specks."""

MIN_PICTURE = 32
"""Pixels per side below which a picture cannot hold a square with its ground."""

WORKING_SIZE = 1000
"""Longest side, in pixels, of the picture that is searched: larger ones are halved, which takes
three quarters of the work and most of the noise away and leaves outlines good to a pixel."""

SURE_SIDE = 15
"""Pixels of the picture that is searched from which a square is found, whichever way it is turned:
a little above the shortest side that an outline may have."""

RANGE_PIXELS = 4_000_000
"""Pixels, at most, from which the range of a picture of more than 8 bits is read: two percentiles
of so many are known to a hundredth of a percent."""

STRIP_ROWS = 256
"""Rows that are stretched to 8 bits at a time, lest a large picture be copied as floats."""


def grey_bytes(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Grey picture of 8 bits, stretched to its own range if it had more; for finding only."""
    return grey_bytes_and_range(image)[0]


def grey_bytes_and_range(
    image: NDArray[np.generic],
) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Return `grey_bytes` and the levels that its 0 and 255 stand for, white being 255."""
    if image.size == 0:
        return np.zeros(image.shape[:2], dtype=np.uint8), (0.0, 0.0)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(_grey(image), dtype=np.uint8), (0.0, 255.0)
    every = 1 + int(np.sqrt(image.shape[0] * image.shape[1] / RANGE_PIXELS))
    some = np.asarray(_grey(image[::every, ::every]), dtype=np.float32)
    darkest, brightest = map(float, np.percentile(some, RANGE_PERCENTILES))
    to_levels = 255.0 / (65535.0 if image.dtype == np.uint16 else 1.0)
    levels = (to_levels * darkest, to_levels * brightest)
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
    """How many pixels of a photograph make one of the picture that is searched."""
    longest, shortest, scale = max(size), min(size), 1
    while longest > WORKING_SIZE and shortest >= MIN_PICTURE:
        longest, shortest, scale = (longest + 1) // 2, (shortest + 1) // 2, 2 * scale
    return scale


def working_picture(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """Smooth picture of moderate size, and how many pixels of the photograph make one of it."""
    scale = working_scale(grey.shape)
    for _ in range(scale.bit_length() - 1):
        grey = np.asarray(cv2.pyrDown(grey), dtype=np.uint8)
    if scale == 1 and min(grey.shape) >= MIN_PICTURE:
        grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0.0), dtype=np.uint8)
    return grey, scale
