"""Pieces of a lattice: crossings that closed cells give their rows and columns."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.links import Links, closed_cells, straight
from trisquare.detection.boards.saddles import Saddles

LEAST_CELLS = 2
"""Adjoining cells that start a lattice: one may come about by chance, and tells less of where
the next crossings are."""

STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""Row and column steps of a lattice's directions, clockwise on the screen: along a row, down a
column, and back."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Crossings in rows and columns, columns clockwise from rows on the screen.

    Attributes
    ----------
    points : ndarray of float64, shape (rows, cols, 2)
        In pixels of the searched picture; NaN where there is none.
    dark_first : bool
        Whether it is dark clockwise of the row that leaves crossing (0, 0).
    """

    points: FloatArray
    dark_first: bool

    @property
    def present(self) -> NDArray[np.bool_]:
        """Which crossings there are, shape (rows, cols)."""
        return np.isfinite(self.points[..., 0])

    @property
    def cell(self) -> float:
        """Length of a typical link, in the direction where they are shorter, pixels."""
        links = [np.linalg.norm(np.diff(self.points, axis=axis), axis=2) for axis in (0, 1)]
        return float(min(np.nanmedian(link) for link in links))


def trimmed(grid: Grid) -> Grid:
    """Leave out empty rows and columns at the rim."""
    rows, cols = np.nonzero(grid.present)
    if not len(rows):
        return Grid(np.zeros((0, 0, 2)), True)
    top, left = int(rows.min()), int(cols.min())
    points = grid.points[top : rows.max() + 1, left : cols.max() + 1]
    return Grid(points, grid.dark_first == ((top + left) % 2 == 0))


def grow(grid: Grid, picture: NDArray[np.uint8], saddles: Saddles) -> Grid:
    """Add neighbouring crossings, round by round, as long as there are any."""
    edges = saddles.edges.reshape(-1, 2)
    points, (top, left) = _core.grow_lattice(
        picture, saddles.points, edges, grid.points, grid.dark_first
    )
    return Grid(points, grid.dark_first == ((top + left) % 2 == 0))


def grids_of(points: FloatArray, links: Links) -> list[Grid]:
    """Put linked crossings into rows and columns, the largest piece first.

    Cells are joined across an edge that both of its crossings' grid lines go straight over, so
    that a fold of the paper ends a piece.
    """
    closed = closed_cells(links)
    across = closed & _goes_on(links, straight(points, links))
    flat = (closed.tolist(), across.tolist(), links.following.tolist(), links.back.tolist())
    seen: set[tuple[int, int]] = set()
    pieces = []
    for start in np.argwhere(closed).tolist():
        if (start[0], start[1]) not in seen:
            places, cells = _piece((start[0], start[1]), flat, seen)
            if cells >= LEAST_CELLS:
                pieces.append(_grid(points, places, start[1] % 2 == 0))
    return sorted(pieces, key=lambda grid: -int(np.count_nonzero(grid.present)))


def _goes_on(links: Links, runs_on: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the lines at both ends of each link run straight on, away from its own cell."""
    here = np.arange(4)
    at_start = runs_on[:, (here + 1) % 4]
    at_end = runs_on[links.following, (links.back + 3) % 4]
    return at_start & at_end


Tables = tuple[list[list[bool]], list[list[bool]], list[list[int]], list[list[int]]]


def _piece(
    start: tuple[int, int], tables: Tables, seen: set[tuple[int, int]]
) -> tuple[dict[int, tuple[int, int]], int]:
    """Rows and columns of the crossings that can be reached from a cell, and how many cells.

    Parameters
    ----------
    start : tuple of int
        Crossing and direction of the link that has the cell on its clockwise side.
    tables : tuple
        Per crossing and direction: whether the cell is closed and may be left over this link,
        what follows, and the direction back.
    seen : set
        Links whose cells have been visited; added to.
    """
    closed, across, following, back = tables
    places = {start[0]: (0, 0)}
    taken = {(0, 0): start[0]}
    queue = deque([(*start, 0)])
    cells = 0
    while queue:
        crossing, direction, step = queue.popleft()
        if (crossing, direction) in seen:
            continue
        walk, fits = [], True
        place = places[crossing]
        for _ in range(4):
            next_one = following[crossing][direction]
            walk.append((crossing, direction, step, next_one, back[crossing][direction]))
            place = (place[0] + STEPS[step][0], place[1] + STEPS[step][1])
            fits &= places.get(next_one, place) == place
            fits &= taken.get(place, next_one) == next_one
            direction = (back[crossing][direction] + 3) % 4
            crossing, step = next_one, (step + 1) % 4
        if not fits:  # round a corner of the room, or a false link
            continue
        cells += 1
        for crossing, direction, step, next_one, returning in walk:
            seen.add((crossing, direction))
            row, col = places[crossing]
            place = (row + STEPS[step][0], col + STEPS[step][1])
            places[next_one], taken[place] = place, next_one
            if across[crossing][direction] and closed[next_one][returning]:
                queue.append((next_one, returning, (step + 2) % 4))
    return places, cells


def _grid(points: FloatArray, places: dict[int, tuple[int, int]], dark: bool) -> Grid:
    """Grid of some crossings; `dark` tells of the row that leaves (0, 0) of `places`."""
    at = np.array(list(places.values()))
    first = at.min(axis=0)
    grid = np.full((*(at.max(axis=0) - first + 1), 2), np.nan)
    grid[at[:, 0] - first[0], at[:, 1] - first[1]] = points[list(places)]
    return Grid(grid, dark == (int(first.sum()) % 2 == 0))
