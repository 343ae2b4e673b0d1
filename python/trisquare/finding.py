"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare.lattice_edges import FoundLattice
from trisquare.lattices import find_lattices, region
from trisquare.outlines import Lattice, find_chessboard, find_squares, grey_bytes
from trisquare.pictures import Image
from trisquare.spans import Found
from trisquare.square_edges import FoundSquare
from trisquare.targets import Targets


def find(picture: Image, targets: Targets) -> Sequence[Found]:
    """Find the targets in a checked picture; the list may be empty."""
    grey = grey_bytes(picture)
    if targets.board is not None:
        lattice = find_chessboard(grey, *targets.board)
        return [] if lattice is None else [FoundLattice.of(lattice, grey)]
    lattices = find_lattices(grey) if targets.lattices else []
    squares = _squares_beside(grey, lattices)
    return [FoundLattice.of(lattice, grey) for lattice in lattices] + squares


def _squares_beside(grey: NDArray[np.uint8], lattices: Sequence[Lattice]) -> list[Found]:
    """Find squares that are no part of a lattice: neither its cells nor the sheet it is on."""
    regions = [region(lattice) for lattice in lattices]
    if regions:
        grey = grey.copy()
    for polygon in regions:  # painted over, which spares the search thousands of contours
        corners = np.rint(polygon).astype(np.int32)
        level = cv2.mean(grey, _mask(grey.shape, corners))[0]
        cv2.fillConvexPoly(grey, corners, level)
    return [
        FoundSquare(square)
        for square in find_squares(grey)
        if not any(_inside(polygon, square.outer.corners.mean(axis=0)) for polygon in regions)
    ]


def _mask(shape: tuple[int, ...], corners: NDArray[np.int32]) -> NDArray[np.uint8]:
    mask = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(mask, corners, 255.0)
    return mask


def _inside(polygon: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    x, y = point.tolist()
    return cv2.pointPolygonTest(polygon.astype(np.float32), (x, y), False) >= 0.0
