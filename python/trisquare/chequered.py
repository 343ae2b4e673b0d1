"""Telling a chessboard from a grille, a keyboard or a mosaic of one colour of tiles.

Blurred, or in a coarse picture, dark tiles apart from each other look like a chessboard that stands
on its corner: crossings lie where two tiles are nearest. But there the picture is as light as what
is between the tiles. On a chessboard, light and dark meet in every crossing, so that it is as light
as the middle of an edge is, whatever the blur and the tone curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare.grids import Grid
from trisquare.quads import sample

BESIDE = 0.08
"""Of an edge's length: how far beside its middle the light and the dark side are looked at. The rim
of a marker is an eighth of its cell, seen aslant less."""

MOST_UNLIKE = 0.36
"""Mean difference between the middle of an edge and its two crossings, over the step across the
edge. Rendered boards have 0.05, prints whose ink has spread 0.31, grilles 0.42 and more, also with
a blur of two pixels."""


def is_chequered(grid: Grid, grey: NDArray[np.uint8], scale: int) -> bool:
    """Whether crossings are as light in a photograph as the edges between them.

    Parameters
    ----------
    grid : Grid
        In a picture that was reduced by `scale`.
    grey : ndarray of uint8, shape (H, W)
        The photograph.
    scale : int
        Pixels of the photograph per pixel of the searched picture.
    """
    points = scale * grid.points
    start = np.concatenate([points[:, :-1].reshape(-1, 2), points[:-1].reshape(-1, 2)])
    end = np.concatenate([points[:, 1:].reshape(-1, 2), points[1:].reshape(-1, 2)])
    rows, cols = np.indices(grid.present.shape)
    dark = np.where((rows + cols) % 2 == 0, 1.0, -1.0)
    signs = np.concatenate([dark[:, :-1].ravel(), -dark[:-1].ravel()])
    known = np.isfinite(start[:, 0]) & np.isfinite(end[:, 0])
    start, end, signs = start[known], end[known], signs[known]

    middle, along = 0.5 * (start + end), end - start
    beside = BESIDE * np.stack([-along[:, 1], along[:, 0]], axis=1)
    steps = signs * (sample(grey, middle - beside) - sample(grey, middle + beside))
    step = abs(float(steps.mean()))
    unlike = sample(grey, middle) - 0.5 * (sample(grey, start) + sample(grey, end))
    # What lies over some of the edges shall not count for more than it can.
    return bool(abs(np.clip(unlike, -step, step).mean()) < MOST_UNLIKE * step)
