"""Chessboards where a scene has squares."""

from __future__ import annotations

from dataclasses import replace

from trisquare.simulate.scene import Scene


def with_boards(squares: Scene, inner_corners: tuple[int, int], extent: int) -> Scene:
    """Put a chessboard in place of each square, so many of its cells as long as the side."""
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
