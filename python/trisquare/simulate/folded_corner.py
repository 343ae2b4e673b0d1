"""The printed corner as it stands when it is folded: three planes at right angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trisquare.printing.layout import TargetPage
from trisquare.simulate.scene import Array

CORNER_DIAGONAL = np.ones(3) / np.sqrt(3.0)
"""Along it a camera sees the three faces alike, each tilted by 54.7 degrees."""

# How the sheet's right, down and into-the-paper turn when it is folded about the lines between
# the upper left face, which stays, and its two neighbours: columns, in the corner's frame.
_STAYS = np.eye(3)
_RIGHT_FOLDED_UP = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
_LOWER_FOLDED_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


class FoldedFrame(NamedTuple):
    """Where a frame of the folded corner is: ``X_corner = rotation @ X_plane + translation``.

    The corner's frame has its origin at the apex, x and y right and down in the sheet's upper
    left face, z into that face; the frames' planes are on its negative axes. The plane's origin
    is the frame's centre, its axes right, down and into the paper.
    """

    rotation: Array  # corner_from_plane, shape (3, 3)
    translation: Array  # millimetres, shape (3,)
    side: float  # millimetres
    inner: float


def folded_frames(page: TargetPage) -> list[FoldedFrame]:
    """Fold a corner's page, print inside.

    Raises
    ------
    ValueError
        If the page is a flat one.
    """
    if page.apex is None:
        raise ValueError("a flat page has no corner: ask for printed_target('corner')")
    turns = (_STAYS, _RIGHT_FOLDED_UP, _LOWER_FOLDED_UP)
    frames = []
    for frame, turn in zip(page.frames, turns, strict=True):
        on_sheet = np.append(np.subtract(frame.centre, page.apex), 0.0)
        frames.append(FoldedFrame(turn, turn @ on_sheet, frame.side, frame.inner))
    return frames
