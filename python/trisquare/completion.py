"""Where a lattice's next crossings must be, although nothing was found there."""

from __future__ import annotations

import numpy as np

from trisquare.grids import Grid
from trisquare.saddles import MARGIN
from trisquare.surface import Surface


def with_neighbours(grid: Grid, shape: tuple[int, ...]) -> Grid:
    """Add a crossing at every empty site next to one, where the surface has it.

    Parameters
    ----------
    grid : Grid
    shape : tuple of int
        Of the picture that it is in.

    Returns
    -------
    Grid
        With one more row and column on every side.
    """
    points = np.pad(grid.points, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    present = np.isfinite(points[..., 0])
    beside = np.zeros_like(present)
    beside[1:] |= present[:-1]
    beside[:-1] |= present[1:]
    beside[:, 1:] |= present[:, :-1]
    beside[:, :-1] |= present[:, 1:]
    beside &= ~present
    sites = np.argwhere(beside)[:, ::-1].astype(np.float64) - 1.0
    at = Surface.of(grid, shape).at(sites)
    inside = (at >= MARGIN) & (at <= np.array(shape[1::-1]) - 1 - MARGIN)
    points[beside] = np.where(inside.all(axis=1, keepdims=True), at, np.nan)
    return Grid(points, grid.dark_first)
