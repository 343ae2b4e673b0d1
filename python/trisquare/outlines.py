"""Coarse outlines of squares and chessboards in a photograph.

The outlines are good to a pixel or two and exist to tell the measurement of the edges where to
look; no figure of a calibration depends on their accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare.chessboard import chessboard_corners
from trisquare.curved_sides import fit_sides
from trisquare.figures import alignment, find_figures
from trisquare.quads import RANGE_PERCENTILES, FloatArray, Quads, find_quads
from trisquare.square_views import views_of_squares

WORKING_SIZE = 1000
"""Longest side, in pixels, of the picture that is searched: larger ones are halved, which takes
three quarters of the work and most of the noise away and leaves outlines good to a pixel."""

ENOUGH = 3
"""Squares that a calibration asks for; where fewer are found, the picture is searched again at half
its size, where a blur of 4 pixels is one of 2 and four pixels share their noise."""

MIN_PICTURE = 32
"""Pixels per side below which a picture cannot hold a square with its ground."""


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


@dataclass(frozen=True, slots=True, eq=False)
class SquareOutline:
    """A solid square, or a frame with a second, inner outline numbered like the outer one."""

    outer: Outline
    inner: Outline | None


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


def find_squares(image: NDArray[np.generic]) -> list[SquareOutline]:
    """Find dark squares on a lighter ground and light ones on a darker, solid or framed.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.

    Returns
    -------
    list of SquareOutline
        From the largest to the smallest; empty if there is none.
    """
    picture, scale = _working_picture(grey_bytes(image))
    if min(picture.shape) < MIN_PICTURE:
        return []
    squares = _squares_of(picture, scale)
    if len(squares) < ENOUGH and min(picture.shape) >= 2 * MIN_PICTURE:
        coarser = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        others = _squares_of(coarser, 2 * scale)
        squares += [other for other in others if not _overlaps(other, squares)]
    return sorted(squares, key=lambda square: -_area(square.outer))


def _squares_of(picture: NDArray[np.uint8], scale: int) -> list[SquareOutline]:
    """Squares of a smooth picture, in pixels of the photograph, `scale` to one of its own."""
    smooth = picture.astype(np.float32)
    quads = fit_sides(smooth, find_quads(picture, smooth))
    quads = views_of_squares(quads, image_size=(picture.shape[1], picture.shape[0]))
    squares = []
    for figure in find_figures(smooth, quads):
        outer = _outline(quads, figure.outer, 0, scale)
        inner = None
        if figure.inner is not None:
            places = alignment(quads.corners[figure.inner], quads.corners[figure.outer])
            inner = _outline(quads, figure.inner, places, scale)
        squares.append(SquareOutline(outer, inner))
    return squares


def _overlaps(square: SquareOutline, others: list[SquareOutline]) -> bool:
    """Whether a square's middle lies in another one, or the other's in it."""
    return any(
        cv2.pointPolygonTest(one.outer.corners.astype(np.float32), tuple(middle), False) >= 0
        for other in others
        for one, two in ((square, other), (other, square))
        for middle in [two.outer.corners.mean(axis=0)]
    )


def find_chessboard(image: NDArray[np.generic], cols: int, rows: int) -> Lattice | None:
    """Find the one chessboard with `cols` x `rows` inner corners.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    cols, rows : int
        Inner corners along the board's two directions, at least 3 each.

    Returns
    -------
    Lattice or None
        None if the picture shows no such board.
    """
    if min(cols, rows) < 3:
        raise ValueError(f"a chessboard needs 3 x 3 inner corners or more, not {cols} x {rows}")
    grey = grey_bytes(image)
    if min(grey.shape) < MIN_PICTURE:
        return None
    corners = chessboard_corners(grey, cols, rows)
    if corners is None:
        return None
    corners.flags.writeable = False
    return Lattice(corners, np.ones(corners.shape[:2], bool))


def grey_bytes(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Grey picture of 8 bits, stretched to its own range if it had more; for finding only."""
    if image.size == 0:
        return np.zeros(image.shape[:2], dtype=np.uint8)
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)  # type: ignore[arg-type]
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image, dtype=np.uint8)
    values = np.asarray(image, dtype=np.float32)
    darkest, brightest = np.percentile(values, RANGE_PERCENTILES)
    if not brightest > darkest:
        return np.zeros(values.shape, dtype=np.uint8)
    stretched = (values - darkest) * (255.0 / (brightest - darkest))
    return np.asarray(np.clip(np.rint(stretched), 0.0, 255.0), dtype=np.uint8)


def _working_picture(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """Smooth picture of moderate size, and how many pixels of the photograph make one of it."""
    scale = 1
    while max(grey.shape) > WORKING_SIZE and min(grey.shape) >= MIN_PICTURE:
        grey, scale = np.asarray(cv2.pyrDown(grey), dtype=np.uint8), 2 * scale
    if scale == 1 and min(grey.shape) >= MIN_PICTURE:
        grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0.0), dtype=np.uint8)
    return grey, scale


def _outline(quads: Quads, index: int, places: int, scale: int) -> Outline:
    """Outline in pixels of the photograph, its numbering rolled by `places`."""
    # pyrDown keeps every second pixel's centre, so that coordinates only need the factor.
    corners = scale * np.roll(quads.corners[index], places, axis=0)
    sides = scale * np.roll(quads.sides[index], places, axis=0)
    corners.flags.writeable = sides.flags.writeable = False
    first, second, third, fourth = sides
    return Outline(corners, (first, second, third, fourth), bool(quads.dark_inside[index]))


def _area(outline: Outline) -> float:
    return float(cv2.contourArea(outline.corners.astype(np.float32)))
