"""What belongs to a board that was found: its cells, their markers, and the sheet it is on.

Squares are looked for beside boards, and over them: somebody may hold one in front of another.
What was seen of a board is painted over, and of the rest a square is told from the board's own
parts by where it stands among the grid lines.
"""

from __future__ import annotations

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice

NEAREST = 16
"""Crossings about a place by which it is numbered: those of four by four, from which lines that
the lens bends are nearly straight."""

RIM = 1.0
"""Cells that every board goes on beyond its outermost crossings. There and within, what blur,
glare and hands make of its cells is as large as one, and stands anywhere."""

BEYOND = 2.0
"""Cells that a board may go on beyond its outermost crossings: it has one more, and where something
covers that or its edge, a row of crossings is lost too."""

LARGEST_PART = 1.4
"""Cells: side of the largest part, a cell as large as the blur of both colours makes it."""

OFF_CENTRE = 0.2
"""Cells from the middle of a cell to that of a part, as much as the lens bends lines beyond the
board; a square that was put there by chance is nearer once in six times."""

OFF_GRID = 0.25
"""Sides of a part from its corners to where they were if it stood along the grid lines."""

CELL_CROSSINGS = 4
"""Crossings that are seen within what is under a board: those of a cell. Nothing over a board
shows one, but for a corner or two that lie on its edge."""


def whole_cells(lattice: Lattice) -> FloatArray:
    """Corners of all cells whose four crossings were found, in order round, shape (M, 4, 2)."""
    present, at = lattice.present, lattice.crossings
    whole = present[:-1, :-1] & present[:-1, 1:] & present[1:, 1:] & present[1:, :-1]
    return np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=2)[whole]


def belongs_to(lattice: Lattice, corners: FloatArray) -> bool:
    """Whether a quad, corners of shape (4, 2), is a part of a lattice or lies under it."""
    return _is_under(lattice, corners) or _is_cell(lattice, corners)


def _is_under(lattice: Lattice, corners: FloatArray) -> bool:
    """Whether a quad shows the lattice within: a square over it would hide it."""
    polygon = corners.astype(np.float32)
    low, high = corners.min(axis=0), corners.max(axis=0)
    points = lattice.crossings[lattice.present]
    near = points[((points > low) & (points < high)).all(axis=1)]
    within = [
        cv2.pointPolygonTest(polygon, (x, y), measureDist=False) > 0.0 for x, y in near.tolist()
    ]
    return sum(within) >= CELL_CROSSINGS


def _is_cell(lattice: Lattice, corners: FloatArray) -> bool:
    """Whether a quad is no larger than a cell and on the board, or is as the cells beyond are."""
    numbers = _numbers(lattice, corners)
    if numbers is None:
        return False
    middle = numbers.mean(axis=0)
    first, second = numbers[2:] - numbers[:2]
    side = np.sqrt(0.5 * abs(first[0] * second[1] - first[1] * second[0]))
    last = np.array(lattice.present.shape[::-1]) - 1.0
    if (middle < -BEYOND).any() or (middle > last + BEYOND).any() or side > LARGEST_PART:
        return False
    if (middle > -RIM).all() and (middle < last + RIM).all():
        return True
    off_centre = np.abs(middle - np.floor(middle) - 0.5).max()
    off_grid = np.abs(np.abs(numbers - middle) - 0.5 * side).max()
    return bool(off_centre < OFF_CENTRE and off_grid < OFF_GRID * side)


def _numbers(lattice: Lattice, points: FloatArray) -> FloatArray | None:
    """Columns and rows of points, shape (N, 2), as the crossings nearby are numbered.

    None where these leave it open.
    """
    rows, cols = np.nonzero(lattice.present)
    at = lattice.crossings[rows, cols]
    gaps = np.linalg.norm(at - points.mean(axis=0), axis=1)
    near = np.argsort(gaps, kind="stable")[:NEAREST]
    numbers = np.stack([cols, rows], axis=1)[near].astype(np.float64)
    found, _ = cv2.findHomography(at[near], numbers)
    if found is None:
        return None
    known, mapped = (
        np.column_stack([some, np.ones(len(some))]) @ np.asarray(found, np.float64).T
        for some in (at[near], points)
    )
    # Beyond the plane's horizon, on the other side than the crossings, nothing is seen of it.
    seen = (mapped[:, 2] * known[0, 2] > 0.0).all()
    return mapped[:, :2] / mapped[:, 2:] if seen else None
