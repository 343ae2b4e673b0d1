"""Chessboards in place of a scene's squares."""

from __future__ import annotations

from dataclasses import replace

from trisquare.simulate.scene import Scene


def with_boards(squares: Scene, inner_corners: tuple[int, int], extent: int) -> Scene:
    """Replace each square by a chessboard, `extent` of whose cells are as long as its side."""
    boards = (
        replace(
            target,
            kind="chessboard",
            inner_corners=inner_corners,
            translation=extent * target.translation,
        )
        for target in squares.targets
    )
    return replace(squares, targets=tuple(boards))
