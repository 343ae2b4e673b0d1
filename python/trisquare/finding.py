"""Finding what a picture shows: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence

from trisquare.hand_drawn import DrawnSquare
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


def find_drawn(picture: Image, drawn: Sequence[DrawnSquare]) -> list[FoundSquare | str]:
    """Find squares where they are drawn in a checked picture, or say why there is none."""
    grey = grey_bytes(picture)
    settled = [settle(grey, square) for square in drawn]
    return [found if isinstance(found, str) else FoundSquare(found) for found in settled]
