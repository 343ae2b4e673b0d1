"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

from trisquare.lattice_edges import FoundLattice
from trisquare.outlines import find_chessboard, find_squares, grey_bytes
from trisquare.pictures import Image
from trisquare.rejected import Rejected
from trisquare.sheet_search import find_sheets
from trisquare.spans import Found
from trisquare.square_edges import FoundSquare
from trisquare.targets import Targets


def find(picture: Image, targets: Targets) -> Sequence[Found | Rejected]:
    """Find the targets in a checked picture, and what is none after all; the list may be empty."""
    grey = grey_bytes(picture)
    if targets.layout is not None:
        return find_sheets(grey, targets.layout)
    if targets.board is not None:
        lattice = find_chessboard(grey, *targets.board)
        return [] if lattice is None else [FoundLattice.of(lattice, grey)]
    outlines = find_squares(grey, targets.tags)
    return [FoundSquare(outline) for outline in outlines if targets.squares or outline.tag]
