"""What the crossings of a plane have in common: they lie smoothly.

A plane's crossings are those of a homography, moved by the lens along its radii. A crossing that
was mistaken leaves that by itself; paper that is folded leaves it all along the fold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.grids import Grid, trimmed
from trisquare.detection.boards.surface import Surface

STRAY = 5.0
"""Times the typical deviation, beyond which a crossing is a stray."""

LEAST_STRAY = 0.8
LEAST_STRAY_CELLS = 0.06
"""Pixels of the searched picture, and cells, that a crossing may always be off: its own error, and
what curled paper does besides the smooth surface."""

FOLDED = 0.1
LEAST_FOLDED = 0.6
"""Deviation of a whole row or column, in cells and at least in pixels, that tells a fold. Paper
that curls leaves half of it, a fold of 30 degrees twice as much."""

MOST_FOLDS = 2
"""Folds after one another that a lattice is split at: two that meet in a room's corner."""

MOST_SITES = 1000
"""Sites of a lattice beyond which no fold is looked for: it bounds the time in a strange picture,
and boards of 30 x 30 cells are the largest."""

LEAST_PART = 3
"""Rows or columns on either side of a fold."""


def smooth_parts(grid: Grid, shape: tuple[int, ...], most_folds: int = MOST_FOLDS) -> list[Grid]:
    """Split a grid where the paper is folded along a row or a column, and leave out strays.

    What is too small to tell whether it is smooth is left out: a row or two of another board.

    Parameters
    ----------
    grid : Grid
    shape : tuple of int
        Of the picture that the grid is in.
    most_folds : int
        Folds after one another that are looked for.
    """
    if not is_large(grid):
        return []
    deviation = Surface.of(grid, shape).deviations(grid)
    if np.nanmax(deviation) < LEAST_FOLDED:
        return [grid]
    whole, flat = _roughness(deviation), _flat(grid)
    if whole <= flat or not most_folds or grid.present.size > MOST_SITES:
        return [_without_strays(grid, deviation)]
    best, parts = (0, whole), [grid]
    for axis in (0, 1):
        for cut in range(1, grid.present.shape[axis]):
            pair = [part for part in _cut(grid, axis, cut) if is_large(part)]
            if not pair:
                continue
            rough = 0.0
            for part in sorted(pair, key=lambda one: one.present.size):
                rough = max(rough, _roughness(Surface.of(part, shape).deviations(part)))
                if rough > max(flat, best[1]):  # the other, larger one, does not matter
                    break
            kept = sum(int(np.count_nonzero(part.present)) for part in pair)
            # Of cuts that leave flat parts, the one that loses least; else the flattest.
            rank = (-kept if rough <= flat else 0, rough)
            if rank < best:
                best, parts = rank, pair
    left = most_folds - 1 if parts[0] is not grid else 0
    return [smooth for part in parts for smooth in smooth_parts(part, shape, left)]


def is_smooth(grid: Grid, shape: tuple[int, ...]) -> bool:
    """Whether a grid has neither fold nor stray."""
    deviation = Surface.of(grid, shape).deviations(grid)
    if np.nanmax(deviation) < LEAST_FOLDED:
        return True
    return _roughness(deviation) <= _flat(grid) and not _strays(grid, deviation).any()


def is_large(grid: Grid) -> bool:
    """Whether a grid is large enough to tell whether it is smooth."""
    present: NDArray[np.bool_] = grid.present
    return int(np.count_nonzero(present)) >= LEAST_PART**2 and min(present.shape) >= LEAST_PART


def _without_strays(grid: Grid, deviation: FloatArray) -> Grid:
    """Leave out crossings that are off the smooth surface of the others."""
    stray = _strays(grid, deviation)
    if not stray.any():
        return grid
    return Grid(np.where(stray[..., None], np.nan, grid.points), grid.dark_first)


def _strays(grid: Grid, deviation: FloatArray) -> NDArray[np.bool_]:
    least = max(LEAST_STRAY, LEAST_STRAY_CELLS * grid.cell)
    return np.asarray(deviation > max(STRAY * float(np.nanmedian(deviation)), least))


def _flat(grid: Grid) -> float:
    """Largest deviation of a whole row or column that is no fold, pixels."""
    return max(FOLDED * grid.cell, LEAST_FOLDED)


def _cut(grid: Grid, axis: int, cut: int) -> tuple[Grid, Grid]:
    """Both sides of a row or column; those of the cut itself go with the second."""
    first, second = np.split(grid.points, [cut], axis=axis)
    flipped = cut % 2 == 1
    return trimmed(Grid(first, grid.dark_first)), trimmed(Grid(second, grid.dark_first != flipped))


def _roughness(deviation: FloatArray) -> float:
    """Typical deviation in that row or column where it is largest, pixels."""
    if np.nanmax(deviation) < LEAST_FOLDED:
        return 0.0
    lines = [line[np.isfinite(line)] for table in (deviation, deviation.T) for line in table]
    return max(float(np.median(line)) for line in lines if len(line))
