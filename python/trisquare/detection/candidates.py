"""What a search returns: coarse outlines, good to a pixel or two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

MIN_CONTRAST = 14.0
"""Grey levels: a contrast of 60 in the weak half of strongly uneven light, and blurred."""

ENOUGH = 3
"""Squares that a calibration asks for; where fewer are found, the picture is searched again at half
its size, where a blur of 4 pixels is one of 2 and four pixels share their noise."""


class Tag(NamedTuple):
    """A code that was recognised; turned left `turns` times against its quad's corners."""

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
        """Take sides, shape (4, N, 2), in an order that is rolled by `places`."""
        sides = np.roll(sides, places, axis=0)
        sides.flags.writeable = False
        first, second, third, fourth = sides
        return cls(sides[:, 0], (first, second, third, fourth), dark_inside)


@dataclass(frozen=True, slots=True, eq=False)
class SquareOutline:
    """A solid square, a frame with a second, inner outline numbered like the outer one, or a tag.

    Or a rectangle, whose side 0 is `aspect` times as long as its side 1, or None if that is
    unknown. The corners of a tag begin at the top left of its code. Other things may lie right
    beside the sides of one that `is_beside_others`; `beside` it there may be an outline that is
    not used, such as the other one of a thin frame.
    """

    outer: Outline
    inner: Outline | None
    tag: Tag | None = None
    aspect: float | None = 1.0
    is_beside_others: bool = False
    beside: Outline | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Crossings of a chessboard's grid lines, in pixels of the photograph.

    Attributes
    ----------
    crossings : ndarray of float64, shape (rows, cols, 2)
        Columns go clockwise from rows on the screen: the board is seen from its front. Where
        there is no crossing, the numbers mean nothing (but are finite).
    present : ndarray of bool, shape (rows, cols)
        Which crossings were found; what is hidden or outside the picture is not.
    """

    crossings: FloatArray
    present: NDArray[np.bool_]
