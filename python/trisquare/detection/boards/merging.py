"""Joining the pieces of one board: what lies on the other's surface, crossing upon crossing.

An arm before a board, a highlight or a row of crossings too blurred to see leave pieces of it. As
planes of their own they would be counted as independent, and each tells less than the whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.grids import STEPS, Grid, trimmed
from trisquare.detection.boards.outliers import MOST_SITES, is_smooth
from trisquare.detection.boards.saddles import MARGIN
from trisquare.detection.boards.surface import Surface

Places = NDArray[np.intp]

ASTRAY = 0.3
"""Cells that a piece's crossings may lie off those that another one's surface foretells: fewer
than half a cell, or the next ones might be meant."""

NEARLY = 0.15
LEAST_MISLINKED = 6
"""Cells that each of so many crossings lies off the host's at most: once in a million by chance."""

SAME = 0.25
"""Cells between two crossings that are the same, found twice."""


def joined(grids: list[Grid], scraps: list[Grid], shape: tuple[int, ...]) -> list[Grid]:
    """Join grids that continue each other, and scraps of lattices to grids.

    Parameters
    ----------
    grids : list of Grid
        Each large enough to tell of its surface.
    scraps : list of Grid
        Smaller ones, which are left out if they continue none.
    shape : tuple of int
        Of the picture that they are in.
    """
    hosts = sorted(grids, key=lambda grid: -int(np.count_nonzero(grid.present)))
    pieces = [*hosts, *scraps]
    done: list[Grid] = []
    for first in hosts:
        if not any(first is piece for piece in pieces):  # joined to another one
            continue
        pieces = [piece for piece in pieces if piece is not first]
        host, pieces = _with_pieces(first, pieces, shape)
        done.append(host)
    return done


def _with_pieces(host: Grid, pieces: list[Grid], shape: tuple[int, ...]) -> tuple[Grid, list[Grid]]:
    """Join to a grid what continues it, and return what is left of the pieces."""
    if not pieces:
        return host, pieces
    surface = Surface.of(host, shape)
    left = list(pieces)
    number = 0
    while number < len(left):
        union = _union(host, left[number], surface)
        if union is not None and is_smooth(union, shape):
            host, surface = union, Surface.of(union, shape)
            del left[number]
            number = 0  # it reaches farther now
        elif _is_mislinked(host, left[number], surface):
            del left[number]
        else:
            number += 1
    return host, left


def _union(host: Grid, piece: Grid, surface: Surface) -> Grid | None:
    """Both as one grid, if the piece's crossings lie where the host's must; else None."""
    index: Places = np.argwhere(piece.present)
    sites = surface.sites(piece.points[piece.present])
    if not np.isfinite(sites).all() or not _is_near(host, sites):
        return None
    sites = sites[:, ::-1]  # row, column
    turn = _turn(index, sites)
    if turn is None:
        return None
    along = np.array([STEPS[(turn + 1) % 4], STEPS[turn]])
    turned = index @ along
    offset = np.rint(np.median(sites - turned, axis=0)).astype(np.intp)
    placed = turned + offset
    if np.median(np.abs(sites - placed).max(axis=1)) > ASTRAY:
        return None
    dark = piece.dark_first == ((int(index[0].sum()) + turn) % 2 == 0)
    if dark != (host.dark_first == (int(placed[0].sum()) % 2 == 0)):
        return None
    return _merged(host, piece.points[piece.present], placed)


def _is_mislinked(host: Grid, piece: Grid, surface: Surface) -> bool:
    """Whether a piece has put crossings of the host's own lattice into other rows and columns."""
    sites = surface.sites(piece.points[piece.present])
    with np.errstate(invalid="ignore"):
        off = np.abs(sites - np.rint(sites)).max(axis=1)
    return len(off) >= LEAST_MISLINKED and bool((off < NEARLY).all()) and _is_near(host, sites)


def _is_near(host: Grid, sites: FloatArray) -> bool:
    """Whether columns and rows are no farther from a grid than that is wide."""
    rows, cols = host.present.shape
    beyond = np.maximum(-sites, sites - [cols - 1, rows - 1]).max(axis=1)
    return bool(beyond.min() <= max(rows, cols))


def _turn(index: Places, sites: FloatArray) -> int | None:
    """Which of the host's directions the rows of a piece run in, by linear regression."""
    centred = index - index.mean(axis=0)
    slopes = np.linalg.lstsq(centred.astype(np.float64), sites - sites.mean(axis=0), rcond=None)[0]
    for turn in range(4):
        along = np.array([STEPS[(turn + 1) % 4], STEPS[turn]])
        if np.abs(slopes - along).max() < ASTRAY:
            return turn
    return None


def _merged(host: Grid, points: FloatArray, placed: Places) -> Grid | None:
    """Add points at rows and columns, shape (N, 2), to the host; None if they contradict it."""
    first = np.minimum(placed.min(axis=0), 0)
    last = np.maximum(placed.max(axis=0), np.array(host.present.shape) - 1)
    size = last - first + 1
    if size.prod() > MOST_SITES:
        return None
    merged = np.full((*size, 2), np.nan)
    row, col = placed.T - first[:, None]
    merged[row, col] = points
    rows, cols = host.present.shape
    own = merged[-first[0] : rows - first[0], -first[1] : cols - first[1]]
    twice = host.present & np.isfinite(own[..., 0])
    if twice.any() and np.linalg.norm((own - host.points)[twice], axis=1).max() > SAME * host.cell:
        return None
    own[host.present] = host.points[host.present]
    return trimmed(Grid(merged, host.dark_first == (int(first.sum()) % 2 == 0)))


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
