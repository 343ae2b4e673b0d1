"""Edges between crossings, and the cells that four of them close.

A crossing has four directions, numbered clockwise on the screen so that clockwise of directions
0 and 2 it is dark, and of 1 and 3 light. The next crossing of a grid line has its dark and light
cells the other way round: from an even direction of one to an odd one of the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trisquare import _core
from trisquare.quads import FloatArray, sample
from trisquare.saddles import Saddles

MISALIGNED = 0.95
"""Cosine of how far a neighbour may be beside an edge's direction: 18 degrees, for what noise and
the smoothing of slanted edges do to the direction."""

PLACES = np.array([0.15, 0.3, 0.43, 0.57, 0.7, 0.85])
"""Where the edge between two crossings is looked at, as fractions of the way."""

BESIDE = 1.3
"""Pixels beside an edge where it is light or dark: the blur has faded enough for a sign, and the
white rim of a cell that holds a marker, an eighth of the cell, is not yet crossed."""

FAINTEST = 0.5
"""Least step across an edge over the mean of all its places."""

LEAST_STEP = 3.0
"""Grey levels across an edge: a fifth of a contrast of 30 behind two pixels of blur, 30 with
noise would not be linked by chance along all of `PLACES`."""

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


def aligned(
    saddles: Saddles, index: NDArray[np.intp], vector: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Direction of a saddle that a vector follows best, and whether it follows it well.

    Parameters
    ----------
    saddles : Saddles
    index : ndarray of intp, shape (P,)
        Number of the saddle.
    vector : ndarray of float64, shape (P, 2)
    """
    along = np.einsum("pij,pj->pi", saddles.edges[index], vector)
    edge = np.abs(along).argmax(axis=1)
    best = along[np.arange(len(along)), edge]
    good = np.abs(best) >= MISALIGNED * np.linalg.norm(vector, axis=1)
    return edge + 2 * (best < 0.0), good


def edge_between(
    picture: NDArray[np.float32],
    start: FloatArray,
    end: FloatArray,
    dark_clockwise: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Whether one edge of the right sign leads all the way from one point to another.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    start, end : ndarray of float64, shape (P, 2)
    dark_clockwise : ndarray of bool, shape (P,)
        Whether it should be dark clockwise of the way (on the right hand, as y points down).
    """
    way = end - start
    length = np.linalg.norm(way, axis=1)
    clockwise = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
    at = start[:, None] + PLACES[:, None] * way[:, None]
    offset = BESIDE * clockwise[:, None]
    shades = sample(picture, np.stack([at - offset, at + offset], axis=1))
    steps = (shades[:, 0] - shades[:, 1]) * np.where(dark_clockwise, 1.0, -1.0)[:, None]
    mean = steps.mean(axis=1)
    return np.asarray((steps.min(axis=1) > FAINTEST * mean) & (mean > LEAST_STEP))
