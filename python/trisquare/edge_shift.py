"""The shift of a board's edges toward their dark side.

A tone curve that is not quite the camera's, or clipped white, moves every edge by about the same
amount toward its dark side. Along a grid line of a chessboard that side alternates from cell to
cell, so the line shows the shift as a zigzag, and no calibration is needed to measure it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trisquare.checked import FloatArray

LINE_DEGREE = 4
"""Of the polynomial that a grid line's image follows: distortion bends it, but smoothly."""

ROUNDS = 8
"""Of reweighting; the shift then changes by less than a thousandth of a pixel."""

HUBER_LIMIT = 2.0
"""In robust standard deviations: beyond it a sample counts less."""

MAD_TO_STD = 1.4826
SMALLEST_SCALE = 1e-6


def shift_toward_light(lines: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> float:
    """Return by how much the edges of one board are shifted toward their light side.

    Least squares over all lines at once, a polynomial for each and one shift for all, reweighted
    by Huber's function.

    Parameters
    ----------
    lines : sequence of (points, std, rises)
        Samples of shape (N, 2) in order along each grid line and their standard deviations, shape
        (N,), both in pixels; +1 or -1, shape (N,), where it gets lighter or darker toward the
        right-hand normal.

    Returns
    -------
    float
        In pixels; negative if the edges are shifted toward the dark.
    """
    parts = [_line_part(points, rises) for points, _, rises in lines]
    weights = [1 / std for _, std, _ in lines]
    precision = list(weights)
    shift = 0.0
    for _ in range(ROUNDS):
        products, squares, residuals = 0.0, 0.0, []
        smoothed = [_without_polynomial(*part, w) for part, w in zip(parts, weights, strict=True)]
        for offsets, signs in smoothed:
            products += float(signs @ offsets)
            squares += float(signs @ signs)
        if squares == 0.0:
            return 0.0
        shift = products / squares
        for (offsets, signs), w, p in zip(smoothed, weights, precision, strict=True):
            residuals.append((offsets - shift * signs) * p / w)
        size = np.abs(np.concatenate(residuals))
        limit = HUBER_LIMIT * max(MAD_TO_STD * float(np.median(size)), SMALLEST_SCALE)
        weights = [
            p * np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(r), limit)))
            for p, r in zip(precision, residuals, strict=True)
        ]
    return shift


def without_shift(points: FloatArray, rises: FloatArray, shift: float) -> FloatArray:
    """Return the samples of a line moved back to where its edges are."""
    normal = _normal(points)
    moved: FloatArray = points - shift * rises[:, None] * normal
    return moved


def _normal(points: FloatArray) -> FloatArray:
    x, y = (points[-1] - points[0]).tolist()
    return np.array([-y, x]) / math.hypot(x, y)


def _line_part(
    points: FloatArray, rises: FloatArray
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.float64]]:
    """Return the offsets from a line's chord, the signs, and the basis of its polynomial."""
    normal = _normal(points)
    centred = points - points.mean(axis=0)
    place = centred @ np.array([normal[1], -normal[0]])
    degree = min(LINE_DEGREE, len(points) - 2)
    basis = np.polynomial.legendre.legvander(place / np.abs(place).max(), max(degree, 0))
    return centred @ normal, rises, basis


def _without_polynomial(
    offsets: FloatArray, signs: FloatArray, basis: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted offsets and signs less what a polynomial explains of them."""
    frame, _ = np.linalg.qr(basis * weights[:, None])
    weighted = np.stack([offsets * weights, signs * weights], axis=1)
    left = weighted - frame @ (frame.T @ weighted)
    return left[:, 0], left[:, 1]
