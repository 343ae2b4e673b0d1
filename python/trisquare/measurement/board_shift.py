"""The shift of a board's edges toward their dark side.

A tone curve that is not quite the camera's, or clipped white, moves every edge by about the same
amount toward its dark side. Along a grid line of a chessboard that side alternates from cell to
cell, so the line shows the shift as a zigzag, and no calibration is needed to measure it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray

LINE_DEGREE = 4
"""Of the polynomial that a grid line's image follows: distortion bends it, but smoothly."""

ROUNDS = 8
"""Of reweighting, at most."""

SETTLED = 2e-4
"""Change of the shift, pixels, after which no further round is needed: a tenth of what the best
boards know of it."""

ROUNDING = 1e-12
"""Part of the signs' squares that is left where a line's cells have one sign only."""

HUBER_LIMIT = 2.0
"""In robust standard deviations: beyond it a sample counts less."""

LEAST_KNOWN = {False: 0.2, True: 1e-3}
"""Part of a line's zigzag that a polynomial must leave for the line to say anything of its shift:
of two cells it leaves a seventh, and that hangs on the samples next to the one crossing. Only where
the shift is `evident` in every sample does such a line know it better than the others do."""

MEDIAN_SQUARE = 0.455
"""Median of a standard normal variable's square."""

HALVINGS = 20
"""Of the range in which the lines' variance is looked for: to a millionth of it."""

MAD_TO_STD = 1.4826
SMALLEST_SCALE = 1e-6


def shift_toward_light(lines: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> float:
    """Return the shift that `shift_and_std` finds."""
    return shift_and_std(lines)[0]


def shift_and_std(
    lines: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
) -> tuple[float, float]:
    """Return by how much the edges of one board are shifted toward their light side.

    Least squares over all lines at once, a polynomial for each and one shift for all, reweighted
    by Huber's function.

    Parameters
    ----------
    lines : sequence of (points, std, contrast_signs)
        Samples of shape (N, 2) in order along each grid line and their standard deviations, shape
        (N,), both in pixels; +1 or -1, shape (N,), where it gets lighter or darker toward the
        right-hand normal.

    Returns
    -------
    shift : float
        In pixels; negative if the edges are shifted toward the dark, 0 if the lines do not tell.
    std : float
        Its standard deviation as far as that of the samples goes, pixels; infinite if the lines do
        not tell.
    """
    offsets, signs, basis, precision = _padded(lines)
    weights = precision
    shift, std = 0.0, math.inf
    for _ in range(ROUNDS):
        left, other = _without_polynomial(offsets, signs, basis, weights)
        squares = float(np.sum(other * other))
        # What the polynomials explain of the signs leaves rounding.
        if squares <= ROUNDING * float(np.sum(weights**2)):
            return 0.0, math.inf
        previous, shift = shift, float(np.sum(other * left)) / squares
        std = 1.0 / math.sqrt(squares)
        if abs(shift - previous) < SETTLED:
            break
        used = weights > 0.0
        size = np.abs(left - shift * other) * precision / np.where(used, weights, 1.0)
        limit = HUBER_LIMIT * max(MAD_TO_STD * float(np.median(size[used])), SMALLEST_SCALE)
        weights = precision * np.sqrt(limit / np.maximum(size, limit))
    return shift, std


def shifts_of_lines(
    lines: Sequence[tuple[FloatArray, FloatArray, FloatArray]], shift: float, *, evident: bool
) -> FloatArray:
    """Return each line's own shift, as far as lines are seen to differ from the board's `shift`.

    A line of two or three cells hardly knows its own: a zigzag of so few turns is a bend or a
    tilt. So what each of them says is drawn to the board's, by its variance over that which the
    lines have among themselves beyond it (the median of their squared departures in units of both
    together is that of chance; R. C. Paule & J. Mandel, J. Res. NBS 87 (1982) 377-385).

    Returns
    -------
    ndarray of float64, shape (L,)
        Pixels.
    """
    offsets, signs, basis, weights = _padded(lines)
    left, other = _without_polynomial(offsets, signs, basis, weights)
    known = np.sum(other * other, axis=1)
    known = np.where(known > LEAST_KNOWN[evident] * np.sum(weights * weights, axis=1), known, 0.0)
    seen = known > 0.0
    if not seen.any():
        return np.full(len(lines), shift)
    # Samples whose stated deviations a wrong tone curve has raised scatter less than they say.
    scatter = (left - shift * other)[weights > 0.0]
    variance = float(np.median(scatter * scatter)) / MEDIAN_SQUARE / known[seen]
    variance += np.finfo(np.float64).tiny
    departure = np.sum(other * left, axis=1)[seen] / known[seen] - shift
    squares = departure * departure
    low, high = 0.0, float(squares.max()) / MEDIAN_SQUARE
    middle = [(squares.size - 1) // 2, squares.size // 2]
    for _ in range(HALVINGS):
        between = 0.5 * (low + high)
        ratios = np.sort(squares / (variance + between))  # numpy's median takes ten times longer
        if ratios[middle].mean() > MEDIAN_SQUARE:
            low = between
        else:
            high = between
    shifts = np.full(len(lines), shift)
    shifts[seen] += departure * low / (low + variance)
    return shifts


def without_shift(points: FloatArray, contrast_signs: FloatArray, shift: float) -> FloatArray:
    """Return the samples of a line moved back to where its edges are."""
    normal = _normal(points)
    moved: FloatArray = points - shift * contrast_signs[:, None] * normal
    return moved


def _normal(points: FloatArray) -> FloatArray:
    x, y = (points[-1] - points[0]).tolist()
    return np.array([-y, x]) / math.hypot(x, y)


def _padded(
    lines: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return all lines' offsets from their chords, signs, bases of their polynomials, weights.

    Shapes (L, N), (L, N), (L, N, `LINE_DEGREE` + 1) and (L, N), N being the most samples of a line;
    the others are filled up with zeros.
    """
    counts = np.array([len(points) for points, _, _ in lines])
    used = np.arange(counts.max()) < counts[:, None]
    samples, (signs, weights) = np.zeros((*used.shape, 2)), np.zeros((2, *used.shape))
    samples[used] = np.concatenate([points for points, _, _ in lines])
    signs[used] = np.concatenate([contrast_signs for _, _, contrast_signs in lines])
    weights[used] = 1.0 / np.concatenate([std for _, std, _ in lines])
    normals = np.array([_normal(points) for points, _, _ in lines])
    samples -= (samples.sum(axis=1) / counts[:, None])[:, None]
    place = used * np.einsum("lni,li->ln", samples, normals[:, ::-1] * [-1.0, 1.0])
    place /= np.abs(place).max(axis=1, keepdims=True)
    basis = np.moveaxis(np.polynomial.legendre.legvander(place, LINE_DEGREE), -1, 0)
    # Few samples follow no polynomial of a high degree.
    degrees = np.clip(counts - 2, 0, LINE_DEGREE)
    basis = basis * used * (np.arange(LINE_DEGREE + 1)[:, None] <= degrees)[..., None]
    offsets = used * np.einsum("lni,li->ln", samples, normals)
    return offsets, signs, np.moveaxis(basis, 0, -1), weights


def _without_polynomial(
    offsets: FloatArray, signs: FloatArray, basis: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted offsets and signs less what a polynomial explains of them."""
    weighted = basis * weights[..., None]
    values = np.stack([offsets * weights, signs * weights], axis=-1)
    transposed = weighted.transpose(0, 2, 1)
    gram = transposed @ weighted
    # Degrees that a line of few samples does not have stay at zero.
    unused = np.einsum("lkk->lk", gram) == 0.0
    gram += unused[:, :, None] * np.eye(gram.shape[1])
    left = values - weighted @ np.linalg.solve(gram, transposed @ values)
    return left[..., 0], left[..., 1]


DEGREES = ((12, 3), (6, 2), (4, 1))
"""So many markers allow polynomials of this degree over the sheet: they give two equations for each
unknown or more."""

LEAST_SINE = 1e-3
"""Of the angle between two sides of a marker; no marker is seen that flat."""


def marker_shift(model: FloatArray, sides: Sequence[Sequence[FloatArray]]) -> float:
    """Return by how much the borders of markers are shifted toward the light.

    Parameters
    ----------
    model : ndarray, shape (N, 4, 2)
        Corners of the markers, sheet coordinates, clockwise.
    sides : sequence of N sequences of four ndarrays, shape (M, 2)
        Samples along each side, in the order of the corners, pixels.

    Returns
    -------
    float
        In pixels; 0 where the markers are too few to tell.
    """
    degree = next((degree for least, degree in DEGREES if len(model) >= least), None)
    if degree is None:
        return 0.0
    points = np.array([[side.mean(axis=0) for side in marker] for marker in sides])
    along = np.array([[side[-1] - side[0] for side in marker] for marker in sides])
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    before = np.roll(outward, 1, axis=1)
    sines = before[..., 0] * outward[..., 1] - before[..., 1] * outward[..., 0]
    if not (np.abs(sines) > LEAST_SINE).all():
        return 0.0
    image_from_sheet, _ = cv2.findHomography(
        model.reshape(-1, 2), _corners(points, outward).reshape(-1, 2)
    )
    if image_from_sheet is None or not np.isfinite(image_from_sheet).all():
        return 0.0
    mapped = cv2.perspectiveTransform(model.reshape(1, -1, 2), image_from_sheet)
    expected = np.asarray(mapped, dtype=np.float64).reshape(model.shape)
    # The sides' samples need not be centred on them: only the distance across counts.
    off = ((points - expected) * outward).sum(axis=-1).ravel()
    middles = 0.5 * (model + np.roll(model, -1, axis=1)).reshape(-1, 2)
    x, y = (middles / np.abs(middles).max()).T
    terms = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    smooth = np.stack(terms, axis=1)
    u, v = outward.reshape(-1, 2).T
    unknowns = np.column_stack([np.ones(len(off)), smooth * u[:, None], smooth * v[:, None]])
    solution = np.linalg.lstsq(unknowns, off, rcond=None)[0]
    return float(solution[0])


def _corners(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Where each side meets the one before, shape (N, 4, 2)."""
    offsets = (points * normals).sum(axis=-1)
    both = np.stack([np.roll(normals, 1, axis=1), normals], axis=-2)
    right = np.stack([np.roll(offsets, 1, axis=1), offsets], axis=-1)
    return np.asarray(np.linalg.solve(both, right[..., None])[..., 0])
