"""Parts of a board that was found: its cells, their markers, and the sheet it is on.

Squares are searched for beside boards, and over them: somebody may hold one in front of another.
The cells that were seen are painted over; in the rest, a square is distinguished from the board's
own parts by its position among the grid lines.
"""

from __future__ import annotations

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice

NEAREST_CROSSINGS = 16
"""Number of crossings nearest to a place from which its column and row are computed: four by four,
over which lines that the lens bends are nearly straight."""

RIM_WIDTH = 1.0
"""Distance, in cells, that every board extends beyond its outermost crossings. There and within,
remains of its cells after blur, glare and hands are as large as a cell, at any place."""

MAX_EXTENSION = 2.0
"""Maximum distance, in cells, that a board extends beyond its outermost crossings: it has one more
cell, and where something covers that or its edge, a row of crossings is lost too."""

LARGEST_PART = 1.4
"""Maximum side of a part, in cells: that of a cell enlarged by the blur of both colours."""

MAX_OFF_CENTRE = 0.2
"""Maximum distance from the middle of a cell to that of a part, in cells: as much as the lens bends
lines beyond the board; a square placed by chance is nearer once in six times."""

MAX_OFF_GRID = 0.25
"""Maximum distance of a part's corners, in its sides, from where they were if it stood along the
grid lines."""

CELL_CROSSINGS = 4
"""Minimum number of crossings within a quad that lies under a board: those of a cell. Within a
square over a board none is seen, except for a corner or two on its edge."""


def whole_cells(lattice: Lattice) -> FloatArray:
    """Return corners of all cells whose crossings were all found, in order round, (M, 4, 2)."""
    present, crossings = lattice.present, lattice.crossings
    is_whole = present[:-1, :-1] & present[:-1, 1:] & present[1:, 1:] & present[1:, :-1]
    return np.stack(
        [crossings[:-1, :-1], crossings[:-1, 1:], crossings[1:, 1:], crossings[1:, :-1]], axis=2
    )[is_whole]


def belongs_to(lattice: Lattice, corners: FloatArray) -> bool:
    """Return whether a quad, corners of shape (4, 2), is a part of a lattice or lies under it."""
    return _is_under(lattice, corners) or _is_cell(lattice, corners)


def _is_under(lattice: Lattice, corners: FloatArray) -> bool:
    """Return whether the lattice is visible within a quad: a square over it would hide it."""
    polygon = corners.astype(np.float32)
    low, high = corners.min(axis=0), corners.max(axis=0)
    points = lattice.crossings[lattice.present]
    near = points[((points > low) & (points < high)).all(axis=1)]
    is_within = [
        cv2.pointPolygonTest(polygon, (x, y), measureDist=False) > 0.0 for x, y in near.tolist()
    ]
    return sum(is_within) >= CELL_CROSSINGS


def _is_cell(lattice: Lattice, corners: FloatArray) -> bool:
    """Return whether a quad is no larger than a cell and on the board, or like cells beyond."""
    coordinates = _lattice_coordinates(lattice, corners)
    if coordinates is None:
        return False
    middle = coordinates.mean(axis=0)
    first, second = coordinates[2:] - coordinates[:2]
    side = np.sqrt(0.5 * abs(first[0] * second[1] - first[1] * second[0]))
    last = np.array(lattice.present.shape[::-1]) - 1.0
    if (
        (middle < -MAX_EXTENSION).any()
        or (middle > last + MAX_EXTENSION).any()
        or side > LARGEST_PART
    ):
        return False
    if (middle > -RIM_WIDTH).all() and (middle < last + RIM_WIDTH).all():
        return True
    off_centre = np.abs(middle - np.floor(middle) - 0.5).max()
    off_grid = np.abs(np.abs(coordinates - middle) - 0.5 * side).max()
    return bool(off_centre < MAX_OFF_CENTRE and off_grid < MAX_OFF_GRID * side)


def _lattice_coordinates(lattice: Lattice, points: FloatArray) -> FloatArray | None:
    """Return columns and rows of points, shape (N, 2), by the numbers of the crossings nearby.

    None where these do not determine them.
    """
    rows, cols = np.nonzero(lattice.present)
    crossings = lattice.crossings[rows, cols]
    gaps = np.linalg.norm(crossings - points.mean(axis=0), axis=1)
    near = np.argsort(gaps, kind="stable")[:NEAREST_CROSSINGS]
    coordinates = np.stack([cols, rows], axis=1)[near].astype(np.float64)
    homography, _ = cv2.findHomography(crossings[near], coordinates)
    if homography is None:
        return None
    mapped_crossings, mapped = (
        np.column_stack([pixels, np.ones(len(pixels))]) @ np.asarray(homography, np.float64).T
        for pixels in (crossings[near], points)
    )
    # Points beyond the plane's horizon, on the other side from the crossings, are not on the plane.
    are_on_plane = (mapped[:, 2] * mapped_crossings[0, 2] > 0.0).all()
    return mapped[:, :2] / mapped[:, 2:] if are_on_plane else None
