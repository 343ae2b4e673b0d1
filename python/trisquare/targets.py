"""What to look for in a picture."""

from __future__ import annotations

import re
from dataclasses import dataclass

SMALLEST_BOARD = 3
"""Inner corners per direction that a chessboard must have."""


@dataclass(frozen=True, slots=True)
class Targets:
    """What to look for: squares, or one chessboard of so many inner corners."""

    board: tuple[int, int] | None
    lattices: bool = False
    """Whether to look for chessboards of any size, besides squares."""

    @classmethod
    def parse(cls, text: str) -> Targets:
        """Read ``"auto"``, ``"squares"`` or ``"chessboard:9x6"``.

        Raises
        ------
        TypeError, ValueError
            For anything else.
        """
        if not isinstance(text, str):
            raise TypeError(f"targets must be a string, not {type(text).__name__}")
        if text in ("auto", "squares"):
            return cls(board=None, lattices=text == "auto")
        match = re.fullmatch(r"chessboard:(\d{1,3})x(\d{1,3})", text)
        if match is None:
            raise ValueError(f"unknown targets {text!r}: choose auto, squares, or chessboard:9x6")
        cols, rows = int(match[1]), int(match[2])
        if min(cols, rows) < SMALLEST_BOARD:
            raise ValueError(f"a chessboard needs 3 x 3 inner corners or more, not {cols} x {rows}")
        return cls(board=(cols, rows))


def nothing_found(targets: Targets) -> str:
    """Say what was looked for in vain."""
    if targets.board is None:
        return (
            "no square found: show dark squares on a light ground (or the reverse), whole, apart "
            "from each other, each at least some 30 pixels wide"
        )
    cols, rows = targets.board
    return f"no chessboard of {cols} x {rows} inner corners found"
