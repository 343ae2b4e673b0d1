"""Coarse outlines of squares and chessboards in a photograph.

The outlines are good to a pixel or two and exist to tell the measurement of the edges where to
look; no figure of a calibration depends on their accuracy.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare.chessboard import chessboard_corners
from trisquare.curved_sides import fit_sides
from trisquare.figures import MIN_RELATIVE_SIDE, alignment, find_figures
from trisquare.markers import detect_markers
from trisquare.quads import RANGE_PERCENTILES, FloatArray, Quads, find_quads
from trisquare.square_views import views_of_squares
from trisquare.tag_names import TagSearch
from trisquare.tags import Tag, recognise

WORKING_SIZE = 1000
"""Longest side, in pixels, of the picture that is searched: larger ones are halved, which takes
three quarters of the work and most of the noise away and leaves outlines good to a pixel."""

RANGE_PIXELS = 4_000_000
"""Pixels, at most, from which the range of a picture of more than 8 bits is read: two percentiles
of so many are known to a hundredth of a percent."""

STRIP_ROWS = 256
"""Rows that are stretched to 8 bits at a time, lest a large picture be copied as floats."""

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
    """A solid square, a frame with a second, inner outline numbered like the outer one, or a tag.

    The corners of a tag begin at the top left of its code.
    """

    outer: Outline
    inner: Outline | None
    tag: Tag | None = None


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


def find_squares(
    image: NDArray[np.generic], tag_search: TagSearch | None = None, enough: int = ENOUGH
) -> list[SquareOutline]:
    """Find dark squares on a lighter ground and light ones on a darker, solid or framed; and tags.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    tag_search : TagSearch, optional
        Without it tags are not looked for.
    enough : int
        Squares below which the picture is searched again at half its size.

    Returns
    -------
    list of SquareOutline
        From the largest to the smallest; empty if there is none.
    """
    grey = grey_bytes(image)
    picture, scale = working_picture(grey)
    if min(picture.shape) < MIN_PICTURE:
        return []
    squares = _squares_of(grey, picture, scale, tag_search)
    if len(squares) < enough and min(picture.shape) >= 2 * MIN_PICTURE:
        coarser = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        others = _squares_of(grey, coarser, 2 * scale, tag_search)
        squares += [other for other in others if not _is_known(other.outer.corners, squares)]
    squares += _further_tags(grey, squares)
    return sorted(squares, key=lambda square: -_area(square.outer))


def _squares_of(
    grey: NDArray[np.uint8], picture: NDArray[np.uint8], scale: int, tag_search: TagSearch | None
) -> list[SquareOutline]:
    """Squares of a smooth picture in pixels of the photograph, `scale` to one of its own."""
    smooth = picture.astype(np.float32)
    quads = fit_sides(smooth, find_quads(picture, smooth))
    quads = views_of_squares(quads, image_size=(picture.shape[1], picture.shape[0]))

    def read_tags(indices: NDArray[np.intp]) -> list[Tag | None]:
        assert tag_search is not None
        steps = quads.contrasts[indices].mean(axis=1)
        return recognise(grey, scale * quads.corners[indices], steps, tag_search)

    squares = []
    for figure in find_figures(smooth, quads, None if tag_search is None else read_tags):
        outer = _outline(quads, figure.outer, figure.tag.turns if figure.tag else 0, scale)
        inner = None
        if figure.inner is not None:
            places = alignment(quads.corners[figure.inner], quads.corners[figure.outer])
            inner = _outline(quads, figure.inner, places, scale)
        squares.append(SquareOutline(outer, inner, figure.tag))
    return squares


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
    if image.dtype == np.uint8:
        return np.ascontiguousarray(_grey(image), dtype=np.uint8)
    every = 1 + int(np.sqrt(image.shape[0] * image.shape[1] / RANGE_PIXELS))
    some = np.asarray(_grey(image[::every, ::every]), dtype=np.float32)
    darkest, brightest = np.percentile(some, RANGE_PERCENTILES)
    stretched = np.zeros(image.shape[:2], dtype=np.uint8)
    if not brightest > darkest:
        return stretched
    for top in range(0, len(image), STRIP_ROWS):
        rows = slice(top, top + STRIP_ROWS)
        values = np.asarray(_grey(image[rows]), dtype=np.float32)
        values = np.rint((values - darkest) * (255.0 / (brightest - darkest)))
        stretched[rows] = np.clip(values, 0.0, 255.0)
    return stretched


def _grey(image: NDArray[np.generic]) -> NDArray[np.generic]:
    if image.ndim == 2:
        return image
    contiguous = np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(contiguous, cv2.COLOR_BGR2GRAY))


def working_picture(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
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


def _further_tags(grey: NDArray[np.uint8], found: list[SquareOutline]) -> list[SquareOutline]:
    """Find tags that are too small for the working picture, of the dictionaries that are there.

    OpenCV's detector has to be told of a dictionary, and is, once other tags have named it.
    """
    further: list[SquareOutline] = []
    for name in sorted({square.tag.dictionary for square in found if square.tag is not None}):
        corners = np.array([marker.corners for marker in detect_markers(grey, name)[0]])
        corners = corners.reshape(-1, 4, 2)
        search = TagSearch((name,), stated=True)
        tags = recognise(grey, corners, np.zeros(len(corners)), search)
        for quad, tag in zip(corners, tags, strict=True):
            if tag is not None and not _is_known(quad, (*found, *further)):
                own = np.roll(quad, tag.turns, axis=0)
                ends = np.stack([own, np.roll(own, -1, axis=0)], axis=1)
                own.flags.writeable = ends.flags.writeable = False
                outline = Outline(own, (ends[0], ends[1], ends[2], ends[3]), dark_inside=True)
                further.append(SquareOutline(outline, None, tag))
    sizes = sorted(_side(square.outer) for square in (*found, *further))
    smallest = MIN_RELATIVE_SIDE * sizes[-3] if len(sizes) > 3 else 0.0
    return [square for square in further if _side(square.outer) >= smallest]


def one_in_other(quad: FloatArray, other: FloatArray) -> bool:
    """Whether the middle of one of two quads, shape (4, 2), lies within the other."""
    return any(
        cv2.pointPolygonTest(one.astype(np.float32), tuple(two.mean(axis=0)), False) >= 0.0
        for one, two in ((quad, other), (other, quad))
    )


def _is_known(quad: FloatArray, squares: Iterable[SquareOutline]) -> bool:
    """Whether one of some squares is where a quad is."""
    return any(one_in_other(quad, square.outer.corners) for square in squares)


def _side(outline: Outline) -> float:
    """Mean length of the sides' chords, pixels."""
    along = outline.corners - np.roll(outline.corners, 1, axis=0)
    return float(np.linalg.norm(along, axis=1).mean())


def _area(outline: Outline) -> float:
    return float(cv2.contourArea(outline.corners.astype(np.float32)))
