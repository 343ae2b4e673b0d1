"""Pixels whose grey levels are curved as at a saddle: corners of cells may be there.

Next to a crossing the grey levels rise toward two opposite cells and fall toward the other two,
whatever the lens and the perspective do. That is a negative determinant of their second
derivatives. Which of these places are crossings, and of which board, the core finds out.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

MIN_SADDLE = 1.1
"""Grey levels per square pixel, the geometric mean of a saddle's two curvatures. A crossing of
contrast 30 whose edges are blurred by 2 pixels of the searched picture has 1.6; noise of 8 grey
levels, halved once, leaves 0.4."""

APERTURE = 5
"""Pixels per side of the derivative filters: a smoothing of about one pixel, which cells of five
pixels survive."""

FILTER_GAIN = 64.0
"""What these filters make of a second derivative of one grey level per square pixel."""

RIVAL_WINDOW = 5
LEAST_OF_RIVAL = 0.6
"""A saddle this much weaker than another one in a window of that many pairs of pixels is dropped:
what is printed in a cell, or beside an edge, is finer than the cell and more blurred."""

MARGIN = 6
"""Pixels at the border in which no saddle is looked for: the filters' and the rivals' reach."""

STRIP = 512
"""Rows of a picture that are searched at a time, which bounds the memory that filters take."""


def find_candidates(picture: NDArray[np.uint8]) -> tuple[NDArray[np.int64], FloatArray]:
    """Find the pixels of a grey picture whose grey levels are curved as at a saddle.

    Returns
    -------
    pixels : ndarray of int64, shape (N, 2)
        Column and row, where the curvature is strongest in its neighbourhood.
    strengths : ndarray of float64, shape (N,)
    """
    height, width = picture.shape
    places, strengths = [np.zeros(0, np.intp)], [np.zeros(0, np.float32)]
    for top in range(0, height, STRIP):
        first = max(top - MARGIN, 0)
        pixels, strong = _peaks_of_strip(picture[first : top + STRIP + MARGIN])
        own = (pixels >= (top - first) * width) & (pixels < (top - first + STRIP) * width)
        places.append(pixels[own] + first * width)
        strengths.append(strong[own])
    y, x = np.divmod(np.concatenate(places), width)
    inside = (x >= MARGIN) & (x < width - MARGIN) & (y >= MARGIN) & (y < height - MARGIN)
    strength = np.concatenate(strengths)[inside].astype(np.float64)
    return np.stack([x[inside], y[inside]], axis=1).astype(np.int64), strength


def _peaks_of_strip(strip: NDArray[np.uint8]) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Flat indices of the peaks, and their strengths."""
    strength = _strength(strip)
    highest = cv2.dilate(strength, np.ones((3, 3), np.uint8))
    flat = strength.ravel()
    found = np.flatnonzero(flat > (FILTER_GAIN * MIN_SADDLE) ** 2)
    found = found[flat[found] >= highest.ravel()[found]]
    # The strongest of each 3 x 3 pixels is known: every second of them tells of all.
    rival = cv2.dilate(highest[::2, ::2], np.ones((RIVAL_WINDOW, RIVAL_WINDOW), np.uint8))
    y, x = np.divmod(found, strip.shape[1])
    found = found[flat[found] >= LEAST_OF_RIVAL**2 * rival[y // 2, x // 2]]
    return found, flat[found]


def _strength(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Negative determinant of the second derivatives, times the square of `FILTER_GAIN`."""
    xx = cv2.Sobel(picture, cv2.CV_32F, 2, 0, ksize=APERTURE)
    yy = cv2.Sobel(picture, cv2.CV_32F, 0, 2, ksize=APERTURE)
    xy = cv2.Sobel(picture, cv2.CV_32F, 1, 1, ksize=APERTURE)
    cv2.multiply(xx, yy, dst=xx)
    cv2.multiply(xy, xy, dst=xy)
    return np.asarray(cv2.subtract(xy, xx, dst=xy), dtype=np.float32)
