"""Edges between crossings, and the cells that four of them close.

A crossing has four directions, numbered clockwise on the screen so that clockwise of directions
0 and 2 it is dark, and of 1 and 3 light. The next crossing of a grid line has its dark and light
cells the other way round: from an even direction of one to an odd one of the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.saddles import Saddles

KINK = 0.22
"""How far a crossing may be off the middle of its two neighbours, across and over the half of
their distance: lenses bend a grid line of four cells by 0.1 a crossing, folded paper by more."""

UNEVEN = 1.75
"""Ratio of two neighbouring cells' lengths that no perspective makes at 70 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Which crossing follows in which direction.

    Attributes
    ----------
    following : ndarray of intp, shape (N, 4)
        Number of the crossing that follows crossing i in direction k, or -1.
    back : ndarray of intp, shape (N, 4)
        Which of that one's directions leads back.
    """

    following: NDArray[np.intp]
    back: NDArray[np.intp]


def link(picture: NDArray[np.uint8], saddles: Saddles) -> Links:
    """Link each saddle to the nearest ones that an edge of the picture leads to.

    Parameters
    ----------
    picture : ndarray of uint8, shape (H, W)
    saddles : Saddles
    """
    edges = saddles.edges.reshape(-1, 2)
    following, back = _core.link_crossings(picture, saddles.points, edges)
    return Links(following.astype(np.intp), back.astype(np.intp))


def closed_cells(links: Links) -> NDArray[np.bool_]:
    """Whether the cell clockwise of each link closes after four, shape (N, 4)."""
    here = np.broadcast_to(np.arange(len(links.following))[:, None], links.following.shape)
    at, towards = here, np.broadcast_to(np.arange(4), here.shape)
    closed = np.ones(here.shape, bool)
    for _ in range(4):
        closed &= links.following[at, towards] >= 0
        at, towards = links.following[at, towards], (links.back[at, towards] + 3) % 4
    return np.asarray(closed & (at == here))


def straight(points: FloatArray, links: Links) -> NDArray[np.bool_]:
    """Whether the grid line through each crossing goes on in each direction, shape (N, 4).

    It does not where it ends, has a kink, or its cells' lengths change abruptly.
    """
    ahead = points[links.following] - points[:, None]
    behind = points[:, None] - points[np.roll(links.following, 2, axis=1)]
    both = (links.following >= 0) & (np.roll(links.following, 2, axis=1) >= 0)
    along = np.linalg.norm(ahead, axis=2), np.linalg.norm(behind, axis=2)
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    smooth = np.abs(cross) <= KINK * along[0] * along[1]
    even = (along[0] <= UNEVEN * along[1]) & (along[1] <= UNEVEN * along[0])
    return np.asarray(both & smooth & even & (np.sum(ahead * behind, axis=2) > 0.0))
