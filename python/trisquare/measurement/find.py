"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare.detection.annotations.formats import DrawnTarget
from trisquare.detection.annotations.grid import DrawnGrid
from trisquare.detection.annotations.snap import settle
from trisquare.detection.boards.find import find_chessboard, find_lattices
from trisquare.detection.boards.membership import belongs_to, whole_cells
from trisquare.detection.candidates import ENOUGH, Lattice
from trisquare.detection.grey import grey_bytes
from trisquare.detection.kinds import Targets
from trisquare.detection.sheets.find import SheetMatch, find_sheets
from trisquare.detection.squares.find import find_squares
from trisquare.images.pixels import Image
from trisquare.measurement.boards import FoundLattice
from trisquare.measurement.sheets import FoundSheet
from trisquare.measurement.side_spans import Found
from trisquare.measurement.squares import FoundSquare
from trisquare.results.rejected import Rejected


def find(picture: Image, targets: Targets) -> Sequence[Found | Rejected]:
    """Find the targets in a checked picture, and what is none after all; the list may be empty."""
    grey = grey_bytes(picture)
    if targets.layout is not None:
        return [
            FoundSheet.of(found) if isinstance(found, SheetMatch) else found
            for found in find_sheets(grey, targets.layout)
        ]
    if targets.board is not None:
        lattice = find_chessboard(grey, *targets.board)
        return [] if lattice is None else [FoundLattice.of(lattice, grey)]
    lattices = find_lattices(grey) if targets.lattices else []
    squares = _squares_beside(grey, lattices, targets)
    return [FoundLattice.of(lattice, grey) for lattice in lattices] + squares


def _squares_beside(
    grey: NDArray[np.uint8], lattices: Sequence[Lattice], targets: Targets
) -> list[Found]:
    """Find squares and tags that are no part of a lattice: neither cells nor the sheet it is on."""
    if lattices:
        grey = grey.copy()
    for lattice in lattices:  # painted over, which spares the search thousands of contours
        _paint(grey, np.rint(whole_cells(lattice)).astype(np.int32))
    return [
        FoundSquare(square)
        for square in find_squares(grey, targets.tags, ENOUGH - len(lattices))
        if (targets.squares or square.tag is not None)
        and not any(belongs_to(lattice, square.outer.corners) for lattice in lattices)
    ]


def _paint(grey: NDArray[np.uint8], cells: NDArray[np.int32]) -> None:
    """Fill quads, corners of shape (M, 4, 2), with their mean level."""
    if not len(cells):
        return
    left, top, width, height = cv2.boundingRect(cells.reshape(-1, 2))
    left, top = max(left, 0), max(top, 0)
    part = grey[top : top + height, left : left + width]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(mask, list(cells - np.array([left, top], np.int32)), (255.0,))
    part[mask > 0] = np.rint(cv2.mean(part, mask)[0])


def find_drawn(picture: Image, drawn: Sequence[DrawnTarget]) -> Sequence[Found | Rejected]:
    """Find targets where they are drawn in a checked picture, or say of each why there is none."""
    grey = grey_bytes(picture)
    return [_found_drawn(grey, target) for target in drawn]


def _found_drawn(grey: NDArray[np.uint8], target: DrawnTarget) -> Found | Rejected:
    settled = target.settled(grey) if isinstance(target, DrawnGrid) else settle(grey, target)
    if isinstance(settled, str):
        return Rejected(target.kind, 0, target.corners, settled)
    return FoundLattice.of(settled, grey) if isinstance(settled, Lattice) else FoundSquare(settled)
