"""Results of a search: coarse outlines, accurate to a pixel or two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

MIN_CONTRAST = 14.0
"""Minimum contrast of an edge, grey levels: what blur leaves of a contrast of 60 in the weak half
of strongly uneven light."""

SQUARES_NEEDED = 3
"""Number of squares that a calibration needs; if fewer are found, the picture is searched again at
half its size, where a blur of 4 pixels is one of 2 and four pixels average their noise."""


class Tag(NamedTuple):
    """A decoded tag; its code is turned left `turns` times relative to its quad's corners."""

    dictionary: str
    number: int
    turns: int


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One closed outline of four curved sides, in pixels of the photograph.

    Attributes
    ----------
    corners : ndarray of float64, shape (4, 2)
        Clockwise on the screen (x right, y down).
    sides : tuple of four ndarrays of float64, shape (N, 2)
        Points along side i, from corner i to corner i + 1, both included.
    dark_inside : bool
        Whether the inside is darker than the outside.
    """

    corners: FloatArray
    sides: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    dark_inside: bool

    @classmethod
    def of(cls, sides: FloatArray, dark_inside: bool, places: int = 0) -> Outline:
        """Build an outline from sides, shape (4, N, 2), whose order is rolled by `places`."""
        sides = np.roll(sides, places, axis=0)
        sides.flags.writeable = False
        first, second, third, fourth = sides
        return cls(sides[:, 0], (first, second, third, fourth), dark_inside)


@dataclass(frozen=True, slots=True, eq=False)
class SquareOutline:
    """A solid square, a frame, a tag or a rectangle.

    The second, inner outline of a frame is numbered like the outer one. The corners of a tag begin
    at the top left of its code. Side 0 of a rectangle is `aspect` times as long as its side 1; None
    if that is unknown. If it `is_beside_others`, other things may lie right beside its sides.
    `adjacent` is an unused outline right beside it, if there is one, such as the other one of a
    thin frame.
    """

    outer: Outline
    inner: Outline | None
    tag: Tag | None = None
    aspect: float | None = 1.0
    is_beside_others: bool = False
    adjacent: Outline | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Crossings of a chessboard's grid lines, in pixels of the photograph.

    Attributes
    ----------
    crossings : ndarray of float64, shape (rows, cols, 2)
        Columns go clockwise from rows on the screen: the board is seen from its front. Entries
        without a crossing are finite but meaningless.
    present : ndarray of bool, shape (rows, cols)
        Which crossings were found; those hidden or outside the picture are not.
    """

    crossings: FloatArray
    present: NDArray[np.bool_]
