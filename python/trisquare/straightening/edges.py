"""The edges of a picture that may be images of straight lines."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import NORMAL_MEDIAN, FloatArray
from trisquare.detection.grey import grey_bytes
from trisquare.images.pixels import Image, picture_size

WORKING_SIDE = 2000
"""Maximum longer side of the picture that is searched, pixels: in larger ones sharp edges are not
known more accurately, and the search takes longer."""

SMOOTHING = 1.0
"""Standard deviation of the smoothing, working pixels."""

NOISE_FACTOR = 6.0
"""Minimum gradient of an edge, over the gradient's own noise."""
WEAKEST, STRONGEST = 1.0, 3.0
"""Minimum gradients of an edge everywhere, and of its strongest point, grey levels per pixel."""

TOLERANCE = 0.6
"""Maximum deviation from an arc, working pixels, of the mean of a few edge points."""

SHORTEST = 16
"""Minimum number of points of an arc."""
SHORTEST_PART = 0.025
"""The same over the half diagonal."""

SMALLEST_RADIUS = 0.55
"""Minimum radius of an arc in half diagonals: that of a line's image is at least
``1 / sqrt(-lambda)``, .73 for the strongest lens that is searched."""

BORDER = 0.012
"""Margin along the picture's border, over its longest side: an edge within it along the border is
that of a frame or a scan, which the lens did not bend."""

MAX_ARCS = 1200
"""Maximum number of arcs, the longest ones: the time grows with the square of their number."""

MAX_POINTS = 40
"""Maximum number of points to which a line is reduced; neighbouring edge points have common
errors."""
MIN_MEAN = 3
"""Minimum number of edge points whose mean is one of them."""


@dataclass(frozen=True, slots=True)
class Arcs:
    """The arcs of a picture.

    Parameters
    ----------
    curves : tuple of ndarray, shape (N_i, 2)
        Points in pixels of the photograph, each the mean of a few edge points.
    pixel : float
        Pixels of the photograph per pixel of the searched picture, to which the points' precision
        is proportional.
    """

    curves: tuple[FloatArray, ...]
    pixel: float


def find_arcs(picture: Image) -> Arcs:
    """Return the edges of a picture that are arcs of circles, the longest first."""
    width, height = picture_size(picture)
    # No upscaling; whole numbers of pixels on both sides.
    scale = min(1.0, WORKING_SIDE / max(width, height))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    grey = grey_bytes(picture)
    if size != (width, height):
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTHING)
    min_gradient = max(WEAKEST, NOISE_FACTOR * _gradient_noise(grey))
    half_diagonal = 0.5 * float(np.hypot(*size))
    arcs = _core.find_arcs(
        np.ascontiguousarray(smooth),
        min_gradient,
        max(STRONGEST, 1.5 * min_gradient),
        TOLERANCE,
        max(SHORTEST, round(SHORTEST_PART * half_diagonal)),
        SMALLEST_RADIUS * half_diagonal,
    )
    inner = [arc for arc in arcs if not _is_along_border(arc, size)]
    longest = sorted(inner, key=len, reverse=True)[:MAX_ARCS]
    ratio = np.array([width / size[0], height / size[1]])
    curves = tuple((binned(arc) + 0.5) * ratio - 0.5 for arc in longest)
    return Arcs(curves, float(np.sqrt(ratio.prod())))


def _is_along_border(arc: FloatArray, size: tuple[int, int]) -> bool:
    margin = BORDER * max(size)
    is_near_border = (arc <= margin).all(axis=0) | (arc >= np.array(size) - 1 - margin).all(axis=0)
    return bool(is_near_border.any())


def binned(arc: FloatArray) -> FloatArray:
    """Return at most `MAX_POINTS` means of neighbouring points of an arc, in its order."""
    count = max(2, min(MAX_POINTS, len(arc) // MIN_MEAN))
    starts = np.arange(count) * len(arc) // count
    numbers = np.diff(np.append(starts, len(arc)))
    return np.asarray(np.add.reduceat(arc, starts, axis=0) / numbers[:, None])


def _gradient_noise(grey: npt.NDArray[np.uint8]) -> float:
    """Return the standard deviation of the smoothed gradient's noise, in levels per pixel.

    It is computed from the median of second differences, which few edges affect (J. Immerkaer,
    Computer Vision and Image Understanding 64 (1996) 300-302).
    """
    if min(grey.shape) < MIN_MEAN:
        return 0.0
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    differences = cv2.filter2D(grey.astype(np.float32), -1, kernel)[1:-1, 1:-1]
    pixel_noise = float(np.median(np.abs(differences))) / NORMAL_MEDIAN / 6.0
    # Response of a Gaussian's derivative to white noise.
    return pixel_noise / (float(np.sqrt(8 * np.pi)) * SMOOTHING**2)
