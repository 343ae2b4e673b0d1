"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trisquare.drawing_formats import DrawnTarget
from trisquare.drawn_grid import DrawnGrid
from trisquare.lattice_edges import FoundLattice
from trisquare.outlines import find_chessboard, find_squares, grey_bytes
from trisquare.pictures import Image
from trisquare.settling import settle
from trisquare.spans import Found
from trisquare.square_edges import FoundSquare
from trisquare.targets import Targets


def find(picture: Image, targets: Targets) -> Sequence[Found]:
    """Find the targets in a checked picture; the list may be empty."""
    grey = grey_bytes(picture)
    if targets.board is not None:
        lattice = find_chessboard(grey, *targets.board)
        return [] if lattice is None else [FoundLattice.of(lattice, grey)]
    return [FoundSquare(outline) for outline in find_squares(grey)]


def find_drawn(picture: Image, drawn: Sequence[DrawnTarget]) -> list[Found | str]:
    """Find targets where they are drawn in a checked picture, or say why there is none."""
    grey = grey_bytes(picture)
    return [_found_drawn(grey, target) for target in drawn]


def _found_drawn(grey: NDArray[np.uint8], target: DrawnTarget) -> Found | str:
    if isinstance(target, DrawnGrid):
        lattice = target.settled(grey)
        return lattice if isinstance(lattice, str) else FoundLattice.of(lattice, grey)
    outline = settle(grey, target)
    return outline if isinstance(outline, str) else FoundSquare(outline)
