"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

from trisquare.lattice_edges import FoundLattice
from trisquare.outlines import find_chessboard, find_squares, grey_bytes
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
    return [FoundSquare(outline) for outline in find_squares(grey)]
