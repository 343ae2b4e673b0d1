"""What the crossings of a plane have in common: they lie smoothly.

A plane's crossings are those of a homography, moved by the lens along a smooth curve. A crossing
that was mistaken leaves that by itself; paper that is folded leaves it all along the fold.
"""

from __future__ import annotations

import numpy as np

from trisquare.grids import Grid, trimmed
from trisquare.quads import FloatArray

REWEIGHTINGS = 4
"""Least absolute deviations by reweighting: a few strays have lost their weight by then."""

SETTLED = 0.3
"""Pixels below which deviations weigh the same; the search's own scatter."""

STRAY = 5.0
"""Times the typical deviation, beyond which a crossing is a stray."""

LEAST_STRAY = 1.0
LEAST_STRAY_CELLS = 0.12
"""Pixels of the searched picture, and cells, that a crossing may always be off: its own error, and
what strong lenses do besides the smooth surface."""

FOLDED = 0.06
LEAST_FOLDED = 0.6
"""Deviation of a whole row or column, in cells and at least in pixels, that tells a fold. Lenses
and paper that curls leave a third of it, a fold of 20 degrees twice as much."""

MOST_FOLDS = 2
"""Folds after one another that a lattice is split at: two that meet in a room's corner."""

MOST_SITES = 1000
"""Sites of a lattice beyond which no fold is looked for: it bounds the time in a strange picture,
and boards of 30 x 30 cells are the largest."""

LEAST_PART = 3
"""Rows or columns on either side of a fold."""


def without_strays(grid: Grid) -> Grid:
    """Move crossings that leave the smooth surface of the others onto it."""
    smooth = _smooth(grid)
    deviation = np.linalg.norm(grid.points - smooth, axis=2)
    least = max(LEAST_STRAY, LEAST_STRAY_CELLS * _cell(grid))
    stray = deviation > max(STRAY * float(np.nanmedian(deviation)), least)
    return Grid(np.where(stray[..., None], smooth, grid.points), grid.dark_first)


def unfolded(grid: Grid, most_folds: int = MOST_FOLDS) -> list[Grid]:
    """Split a grid where the paper is folded along a row or a column."""
    flat = max(FOLDED * _cell(grid), LEAST_FOLDED)
    whole = _roughness(grid)
    if whole <= flat or not most_folds or grid.present.size > MOST_SITES:
        return [grid]
    best, parts = (0, whole), [grid]
    for axis in (0, 1):
        for cut in range(1, grid.present.shape[axis]):
            pair = [part for part in _cut(grid, axis, cut) if _is_large(part)]
            if not pair:
                continue
            rough = max(_roughness(part) for part in pair)
            kept = sum(int(np.count_nonzero(part.present)) for part in pair)
            # Of cuts that leave flat parts, the one that loses least; else the flattest.
            rank = (-kept if rough <= flat else 0, rough)
            if rank < best:
                best, parts = rank, pair
    if len(parts) == 1 and parts[0] is grid:
        return [grid]
    return [part for half in parts for part in unfolded(half, most_folds - 1)]


def _cut(grid: Grid, axis: int, cut: int) -> tuple[Grid, Grid]:
    """Both sides of a row or column; those of the cut itself go with the second."""
    first, second = np.split(grid.points, [cut], axis=axis)
    flipped = cut % 2 == 1
    return trimmed(Grid(first, grid.dark_first)), trimmed(Grid(second, grid.dark_first != flipped))


def _is_large(grid: Grid) -> bool:
    """Whether a grid is large enough to tell whether it is smooth."""
    present = grid.present
    return int(np.count_nonzero(present)) >= LEAST_PART**2 and min(present.shape) >= LEAST_PART


def _roughness(grid: Grid) -> float:
    """Typical deviation in that row or column where it is largest, pixels."""
    deviation = np.linalg.norm(grid.points - _smooth(grid), axis=2)
    if np.nanmax(deviation) < LEAST_FOLDED:
        return 0.0
    lines = [line[np.isfinite(line)] for table in (deviation, deviation.T) for line in table]
    return max(float(np.median(line)) for line in lines if len(line))


def _cell(grid: Grid) -> float:
    """Length of a typical short link of a grid, pixels."""
    links = [np.linalg.norm(np.diff(grid.points, axis=axis), axis=2) for axis in (0, 1)]
    return float(min(np.nanmedian(link) for link in links))


def _smooth(grid: Grid) -> FloatArray:
    """Where a smooth surface has each crossing, shape (rows, cols, 2); NaN where there is none."""
    present = grid.present
    at = np.argwhere(present)[:, ::-1].astype(np.float64)
    points = grid.points[present]
    middle = 0.5 * (at.min(axis=0) + at.max(axis=0))
    at = (at - middle) / np.maximum(at.max(axis=0) - middle, 1.0)
    centre, size = points.mean(axis=0), max(float(points.std()), 1e-9)
    scaled = (points - centre) / size
    basis = _powers(at)
    weight = np.ones(len(points))
    for _ in range(REWEIGHTINGS):
        flat = _through_homography(at, scaled, weight)
        root = np.sqrt(weight)[:, None]
        bent = basis @ np.linalg.lstsq(root * basis, root * (scaled - flat), rcond=None)[0]
        off = size * np.linalg.norm(scaled - flat - bent, axis=1)
        if off.max() < LEAST_FOLDED:  # neither a fold nor a stray
            break
        weight = 1.0 / np.maximum(off, SETTLED)
    smooth = np.full(grid.points.shape, np.nan)
    smooth[present] = centre + size * (flat + bent)
    return smooth


def _powers(at: FloatArray) -> FloatArray:
    """Polynomials of the lens's bending: of degree 3, or less where crossings are few."""
    count = len(at)
    degree = 3 if count >= 25 else 2 if count >= 16 else 0
    u, v = at.T
    return np.stack([u**i * v**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


def _through_homography(at: FloatArray, points: FloatArray, weight: FloatArray) -> FloatArray:
    """Where the homography that fits best takes the grid's places, shape (N, 2)."""
    one = np.ones(len(at))
    place = np.column_stack([at, one])
    zero = np.zeros_like(place)
    rows = np.concatenate(
        [
            np.hstack([place, zero, -points[:, :1] * place]),
            np.hstack([zero, place, -points[:, 1:] * place]),
        ]
    )
    rows *= np.tile(weight, 2)[:, None] ** 0.5
    _, vectors = np.linalg.eigh(rows.T @ rows)
    homography = vectors[:, 0].reshape(3, 3)
    mapped = place @ homography.T
    depth = mapped[:, 2:]
    safe = np.where(np.abs(depth) > 1e-9, depth, 1e-9)
    return np.asarray(mapped[:, :2] / safe)
