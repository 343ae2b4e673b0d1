"""Growing a lattice: where the next crossing must be, and whether there is one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare.grids import STEPS, Grid
from trisquare.links import KINK, aligned, edge_between
from trisquare.quads import FloatArray
from trisquare.saddles import Saddles

MOST_ROUNDS = 60
"""Rows and columns that are added one after another."""

MARGIN = 3
"""Empty rows and columns round a growing grid: a prediction looks three crossings back."""

OFF_COURSE = 0.22
"""Cells that a crossing may be off its predicted place; perspective and lens leave a tenth."""


def grow(grid: Grid, picture: NDArray[np.float32], saddles: Saddles) -> Grid:
    """Add neighbouring crossings, round by round, as long as there are any."""
    for _ in range(MOST_ROUNDS):
        grid, added = _with_neighbours(_padded(grid), picture, saddles)
        if not added:
            break
    return trimmed(grid)


def trimmed(grid: Grid) -> Grid:
    """Leave out empty rows and columns at the rim."""
    rows, cols = np.nonzero(grid.present)
    if not len(rows):
        return Grid(np.zeros((0, 0, 2)), True)
    top, left = int(rows.min()), int(cols.min())
    points = grid.points[top : rows.max() + 1, left : cols.max() + 1]
    return Grid(points, grid.dark_first == ((top + left) % 2 == 0))


def _padded(grid: Grid) -> Grid:
    around = ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0))
    points = np.pad(trimmed(grid).points, around, constant_values=np.nan)
    return Grid(points, trimmed(grid).dark_first)  # an even number of steps away


def _shifted(points: FloatArray, row: int, col: int) -> FloatArray:
    """Value at each site of the site `row`, `col` further on; the margin makes rolling safe."""
    return np.roll(points, (-row, -col), axis=(0, 1))


def _predicted(points: FloatArray) -> FloatArray:
    """Where each empty site next to a crossing should be, NaN where nothing tells."""
    total = np.zeros_like(points)
    weight = np.zeros(points.shape[:2])

    def add(guess: FloatArray, confidence: float) -> None:
        known = np.isfinite(guess[..., 0])
        total[known] += confidence * guess[known]
        weight[known] += confidence

    for row, col in STEPS:
        one, two, three = (_shifted(points, n * row, n * col) for n in (1, 2, 3))
        quadratic = 3.0 * (one - two) + three
        linear = 2.0 * one - two
        add(np.where(np.isfinite(quadratic), quadratic, linear), 1.0)
        add(
            _shifted(points, row, col)
            + _shifted(points, -col, row)
            - _shifted(points, row - col, col + row),
            1.0,
        )
        if row + col > 0:
            add(0.5 * (one + _shifted(points, -row, -col)), 4.0)
    empty = ~np.isfinite(points[..., 0]) & (weight > 0.0)
    return np.where(empty[..., None], total / np.where(weight, weight, 1.0)[..., None], np.nan)


def _with_neighbours(
    grid: Grid, picture: NDArray[np.float32], saddles: Saddles
) -> tuple[Grid, bool]:
    """Add every crossing that is where it should be and that edges lead to."""
    predicted = _predicted(grid.points)
    sites = np.argwhere(np.isfinite(predicted[..., 0]))
    if not len(sites) or not len(saddles):
        return grid, False
    wanted = predicted[sites[:, 0], sites[:, 1]]
    gap = np.linalg.norm(saddles.points - wanted[:, None], axis=2)
    chosen = gap.argmin(axis=1)
    nearest = gap.min(axis=1)
    good, cell = _connected(grid, picture, saddles, (sites, chosen))
    good &= nearest < OFF_COURSE * cell
    # A saddle fits into one site only.
    order = np.argsort(np.where(good, nearest, np.inf))
    _, first = np.unique(chosen[order], return_index=True)
    kept = np.zeros(len(sites), bool)
    kept[order[first]] = True
    kept &= good
    if not kept.any():
        return grid, False
    points = grid.points.copy()
    points[sites[kept, 0], sites[kept, 1]] = saddles.points[chosen[kept]]
    return Grid(points, grid.dark_first), True


def _connected(
    grid: Grid,
    picture: NDArray[np.float32],
    saddles: Saddles,
    guess: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Whether edges lead from every present neighbour to the saddle that is tried for a site.

    Returns
    -------
    good : ndarray of bool, shape (S,)
    cell : ndarray of float64, shape (S,)
        The shortest of these edges, pixels.
    """
    sites, chosen = guess
    here = saddles.points[chosen]
    good = np.ones(len(sites), bool)
    cell = np.full(len(sites), np.inf)
    for step, (row, col) in enumerate(STEPS):
        there = grid.points[sites[:, 0] + row, sites[:, 1] + col]
        beyond = grid.points[sites[:, 0] + 2 * row, sites[:, 1] + 2 * col]
        known = np.isfinite(there[:, 0])
        dark = (sites.sum(axis=1) + step + (0 if grid.dark_first else 1)) % 2 == 0
        way = (there - here)[known]
        direction, follows = aligned(saddles, chosen[known], way)
        follows &= (direction % 2 == 0) == dark[known]
        follows &= edge_between(picture, here[known], there[known], dark[known])
        good[known] &= follows
        length = np.linalg.norm(way, axis=1)
        cell[known] = np.minimum(cell[known], length)
        onward = (beyond - there)[known]
        cross = way[:, 0] * onward[:, 1] - way[:, 1] * onward[:, 0]
        good[known] &= ~(np.abs(cross) > KINK * length * np.linalg.norm(onward, axis=1))
    return good & np.isfinite(cell), np.where(np.isfinite(cell), cell, 0.0)
