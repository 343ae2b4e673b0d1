"""Telling a chessboard from a grille, a keyboard or a mosaic of one colour of tiles.

Blurred, or in a coarse picture, dark tiles apart from each other look like a chessboard that stands
on its corner: crossings lie where two tiles are nearest. But there the picture is as light as what
is between the tiles. On a chessboard light and dark meet in every crossing, in equal shares.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare.detection.boards.grids import Grid
from trisquare.detection.sampling import sample

RIM = 0.08
"""Of a cell's side: where a light cell is looked at beside its edges, as it may hold a marker. The
marker's white rim is an eighth."""

SHARES = (0.2, 0.77)
"""How light crossings and the middles of edges may be, from 0 (as dark cells) to 1 (as light ones).
A tone curve lifts the half of it to 0.73, ink that has spread leaves 0.31; crossings of tiles apart
from each other have 0.05 or 0.97, and blurred by two pixels 0.13 or 0.80."""

_CORNERS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
_MIDDLES = ((0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0))
_CENTRE = ((0.5, 0.5),)
_RIMS = ((RIM, 0.5), (1.0 - RIM, 0.5), (0.5, RIM), (0.5, 1.0 - RIM))
_INNER = ((RIM, RIM), (1.0 - RIM, RIM), (RIM, 1.0 - RIM), (1.0 - RIM, 1.0 - RIM))
"""Places in a cell, in units of its sides. The corners of a light cell are farther from a marker
than the middle of its rim, which blur darkens where that is narrow."""


def is_chequered(grid: Grid, grey: NDArray[np.uint8], scale: int) -> bool:
    """Whether a grid's crossings and edges are midway between the light and the dark of its cells.

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
    corners = np.stack([points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]])
    whole = np.isfinite(corners[..., 0]).all(axis=0)
    rows, cols = np.nonzero(whole)
    dark = ((rows + cols) % 2 == 0) == grid.dark_first
    cells = corners[:, whole]

    def level(places: tuple[tuple[float, float], ...], which: NDArray[np.bool_]) -> float:
        weights = np.array(
            [[(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v] for u, v in places]
        )
        return float(sample(grey, np.einsum("pk,kcx->pcx", weights, cells[:, which])).mean())

    if dark.all() or not dark.any():
        return False
    least = level(_CENTRE, dark)
    most = max(level(_CENTRE, ~dark), level(_RIMS, ~dark), level(_INNER, ~dark))
    if most <= least:
        return False
    every = np.ones_like(dark)
    shares = (np.array([level(_CORNERS, every), level(_MIDDLES, every)]) - least) / (most - least)
    return bool((shares > SHARES[0]).all() and (shares < SHARES[1]).all())
