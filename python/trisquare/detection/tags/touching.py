"""Tags whose corners touch dark squares, as on Kalibr's AprilGrids: quads that decode as such.

A threshold in the middle joins what touches; a lower one separates it, and so does eroding the dark
pixels by one. The corners, which are saddles, are then located without a threshold.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import MIN_CONTRAST
from trisquare.detection.tags.decode import BORDER, WIDE_BORDER, agreement
from trisquare.detection.tags.find import SMALLEST_SIDE, shortest_sides

MIN_CORRELATION = 0.8
"""Minimum correlation between the cells of a quad and a code: chance reaches it once in 200 000
quads, for any of 587 codes of 36 cells."""

REACH = 1.0 / 40.0
MIN_REACH = 15
"""Radius within which the darkest and the lightest pixel set the threshold, over the picture's
longest side, and its minimum in pixels. A tag seven times as large still has white within this
distance of its border."""

REDUCTION = 3
"""Reduction of the pictures of darkest and lightest: the threshold need not be finer."""

LARGEST_SEARCHED = 2000
"""Maximum longest side, in pixels, of the picture in which outlines are followed: a larger picture
is reduced, in which a photograph's grain has fewer outlines. Corners are located in the picture
itself."""

MAX_REPEAT_DISTANCE = 3.0
"""Maximum distance between the middles of a tag that is found twice, pixels."""


class Parting(NamedTuple):
    """A way to separate dark corners that touch: a low threshold, and erosion of dark pixels."""

    level: float  # threshold, as a fraction of the way from the darkest to the lightest around
    erosion: int  # pixels
    inset: float  # pixels by which both together move corners inward


PARTINGS = (Parting(0.25, 0, 0.7), Parting(0.4, 1, 1.8))
"""The first separates the blunt corners of blurred tags, the second small tags. The second is tried
if the first has found a tag."""

SADDLE_WINDOW = 0.12
"""Half width of the window in which a corner is located, over a tag's shortest side: less than a
border and than the gaps that are printed."""

SADDLE_WINDOWS = (2, 8)
"""Range of the same in pixels: the least that shows a saddle, and the most that is of use."""

SADDLE_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.01)

MAX_CORNER_STEP = 0.2
"""Maximum distance of a corner from where it was expected, over the shortest side."""


def find_touching_tags(grey: NDArray[np.uint8], name: str) -> tuple[list[int], FloatArray]:
    """Find tags with wide borders, whether or not something dark touches their corners.

    Returns
    -------
    numbers : list of int
    corners : ndarray, shape (N, 4, 2)
        Clockwise from the top left of each code, pixels.
    """
    found: list[int] = []
    corners: list[FloatArray] = []
    scale = math.ceil(max(grey.shape) / LARGEST_SEARCHED)
    searched = grey if scale == 1 else _reduced(grey, scale)
    lowest, highest = _extremes(searched)
    for parting in PARTINGS:
        outlines = (_dark_quads(searched, lowest, highest, parting) + 0.5) * scale - 0.5
        quads = on_saddles(grey, outlines)
        numbers, turns, correlation = agreement(grey, quads, name, WIDE_BORDER)
        read = np.flatnonzero(correlation >= MIN_CORRELATION)
        # Cells of a tag with the usual border may also agree well enough with a code.
        usual = agreement(grey, quads[read], name, BORDER).correlation
        read = read[correlation[read] >= usual]
        upright = [np.roll(quads[index], turns[index], axis=0) for index in read]
        # A tag that both ways find is kept once.
        is_new_quad = [
            not any(
                np.abs(quad.mean(axis=0) - known_quad.mean(axis=0)).max() < MAX_REPEAT_DISTANCE
                for known_quad in corners
            )
            for quad in upright
        ]
        found += [
            int(number) for number, is_new in zip(numbers[read], is_new_quad, strict=True) if is_new
        ]
        corners += [quad for quad, is_new in zip(upright, is_new_quad, strict=True) if is_new]
        if not found:
            break
    return found, np.array(corners).reshape(-1, 4, 2)


def on_saddles(grey: NDArray[np.uint8], quads: FloatArray) -> FloatArray:
    """Move corners, shape (Q, 4, 2), onto the nearest saddles."""
    moved = quads.copy()
    limits = np.array(grey.shape[::-1]) - 1.0
    shortest = shortest_sides(quads)
    windows = np.clip(np.round(SADDLE_WINDOW * shortest), *SADDLE_WINDOWS).astype(int)
    is_inside = ((quads >= 0.0) & (quads <= limits)).all(axis=(1, 2))
    # A call of OpenCV's function takes as long as one corner: call it once per window.
    for window in np.unique(windows[is_inside]).tolist():
        indices = np.flatnonzero(is_inside & (windows == window))
        corners = quads[indices].reshape(-1, 1, 2).astype(np.float32)
        refined = cv2.cornerSubPix(grey, corners, (window, window), (-1, -1), SADDLE_STOP)
        refined = refined.reshape(-1, 4, 2)
        distances = np.linalg.norm(refined - quads[indices], axis=2)
        is_near = distances < MAX_CORNER_STEP * shortest[indices, None]
        moved[indices] = np.where(is_near[..., None], refined, quads[indices])
    return moved


def _dark_quads(
    grey: NDArray[np.uint8],
    lowest: NDArray[np.uint8],
    highest: NDArray[np.uint8],
    parting: Parting,
) -> FloatArray:
    """Return outlines of dark regions with four corners, clockwise, shape (Q, 4, 2)."""
    level = cv2.addWeighted(lowest, 1.0 - parting.level, highest, parting.level, 0.0)
    level[cv2.subtract(highest, lowest) < MIN_CONTRAST] = 0
    threshold = cv2.resize(level, grey.shape[::-1], interpolation=cv2.INTER_LINEAR)
    dark = cv2.compare(grey, threshold, cv2.CMP_LT)
    if parting.erosion:
        dark = cv2.erode(dark, np.ones((2 * parting.erosion + 1,) * 2, np.uint8))
    corners = _core.find_four_cornered(np.asarray(dark, np.uint8), int(SMALLEST_SIDE))
    outward = corners - corners.mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    return np.asarray(corners + parting.inset * outward)


def _extremes(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the darkest and the lightest level around, reduced by `REDUCTION`."""
    reach = max(MIN_REACH, round(REACH * max(grey.shape))) // REDUCTION
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    # Averaged, so that the noise of a plain ground does not look like contrast; the means at all
    # pixels take less time than OpenCV needs for those at every third one.
    height, width = (side // REDUCTION for side in grey.shape)
    middle = slice(REDUCTION // 2, None, REDUCTION)
    small = np.ascontiguousarray(
        cv2.blur(grey, (REDUCTION, REDUCTION))[middle, middle][:height, :width]
    )
    lowest, highest = cv2.erode(small, kernel), cv2.dilate(small, kernel)
    return np.asarray(lowest, dtype=np.uint8), np.asarray(highest, dtype=np.uint8)


def _reduced(grey: NDArray[np.uint8], scale: int) -> NDArray[np.uint8]:
    """Average over squares of `scale` x `scale` pixels; pixels left over are dropped."""
    height, width = (max(side // scale, 1) for side in grey.shape)
    whole = grey[: height * scale, : width * scale]
    small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)
