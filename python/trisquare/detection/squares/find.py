"""Coarse outlines of squares, tags and rectangles in a photograph.

The outlines are accurate to a pixel or two. They only tell the edge measurement where to look; no
result of a calibration depends on their accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas
from trisquare.detection.candidates import SQUARES_NEEDED, Outline, SquareOutline, Tag
from trisquare.detection.grey import MIN_PICTURE, grey_bytes, working_picture
from trisquare.detection.sampling import straight_sides
from trisquare.detection.squares.arc_quads import find_arc_quads
from trisquare.detection.squares.framed import (
    MIN_RELATIVE_SIDE,
    alignment,
    are_uniform,
    find_framed_squares,
)
from trisquare.detection.squares.plain_rectangles import (
    MIN_INLIERS,
    best_per_corner,
    find_rectangles,
    turns_to_longer_side,
)
from trisquare.detection.squares.quads import are_among, find_quads, is_among
from trisquare.detection.squares.rectangle_shape import RectangleShape
from trisquare.detection.squares.rectified import views_of_rectangles
from trisquare.detection.squares.side_curves import fit_sides
from trisquare.detection.tags.decode import decode_tags
from trisquare.detection.tags.families import TagSearch
from trisquare.detection.tags.find import detect_markers
from trisquare.detection.tags.small import dictionaries_of_small_tags, refined_corners

WIDEST_BAR = 14.0
"""Width in pixels up to which the second edge of a bar blurs the pixels that the fit to the first
one reads."""


def find_squares(
    image: NDArray[np.generic],
    tag_search: TagSearch | None = None,
    enough: int = SQUARES_NEEDED,
    is_known: Callable[[FloatArray], bool] = lambda corners: False,
) -> list[SquareOutline]:
    """Find dark squares on a lighter ground and light ones on a darker, solid or framed; and tags.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    tag_search : TagSearch, optional
        Without it tags are not searched for.
    enough : int
        Number of squares below which the picture is searched again at half its size.
    is_known : callable
        Takes the corners of a quad, shape (4, 2); returns whether it is known to be something else,
        so that it is not a small tag that remains to be read.

    Returns
    -------
    list of SquareOutline
        From the largest to the smallest; empty if there is none.
    """
    grey = grey_bytes(image)
    picture, scale = working_picture(grey)
    if min(picture.shape) < MIN_PICTURE:
        return []
    squares, unread = _squares_of(grey, picture, scale, tag_search)
    if len(squares) < enough and min(picture.shape) >= 2 * MIN_PICTURE:
        coarser = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        coarser_squares, _ = _squares_of(grey, coarser, 2 * scale, tag_search)
        known = _corners(squares)
        squares += [
            square for square in coarser_squares if not is_among(square.outer.corners, known)
        ]
    names = {square.tag.dictionary for square in squares if square.tag is not None}
    if tag_search is not None and (unknown := [quad for quad in unread if not is_known(quad)]):
        names |= dictionaries_of_small_tags(grey, unknown, tag_search)
    small_tags = _find_small_tags(grey, squares, names)
    # A square within a tag is one of its cells; one that contains a tag is the sheet.
    if small_tags:
        within = are_among(_corners(squares), _corners(small_tags)).tolist()
        squares = [
            square
            for square, is_cell in zip(squares, within, strict=True)
            if square.tag or not is_cell
        ]
        squares += small_tags
    return sorted(squares, key=lambda square: -float(quad_areas(square.outer.corners)))


def find_plain_rectangles(image: NDArray[np.generic], shape: RectangleShape) -> list[SquareOutline]:
    """Find rectangles of a shape, on any ground and with anything inside.

    Side 0 is one of the longer two. Otherwise as `find_squares`.
    """
    grey = grey_bytes(image)
    picture, scale = working_picture(grey)
    if min(picture.shape) < MIN_PICTURE:
        return []
    smooth = picture.astype(np.float32)
    size = (picture.shape[1], picture.shape[0])
    rough = find_arc_quads(smooth).followed_by(find_quads(picture, smooth))
    quads = views_of_rectangles(fit_sides(picture, rough, MIN_INLIERS), size, shape.aspect)
    quads = best_per_corner(smooth, quads)
    quads = quads.subset(find_rectangles(smooth, quads, shape.aspect))
    if not len(quads):
        return []
    turns = turns_to_longer_side(quads.corners, size, shape)
    found = zip(scale * quads.sides, quads.dark_inside.tolist(), turns.tolist(), strict=True)
    outlines = [
        SquareOutline(Outline.of(*quad), None, aspect=shape.aspect, is_beside_others=True)
        for quad in found
    ]
    return sorted(outlines, key=lambda outline: -float(quad_areas(outline.outer.corners)))


def _squares_of(
    grey: NDArray[np.uint8], picture: NDArray[np.uint8], scale: int, tag_search: TagSearch | None
) -> tuple[list[SquareOutline], FloatArray]:
    """Find squares of a smooth picture, in pixels of the photograph, `scale` to one of its own.

    Also return the dark quads with something inside that are none of these squares, (Q, 4, 2).
    """
    smooth = picture.astype(np.float32)
    coarse = find_quads(picture, smooth)
    quads = fit_sides(picture, coarse)
    quads = views_of_rectangles(quads, image_size=(picture.shape[1], picture.shape[0]))

    def read_tags(indices: NDArray[np.intp]) -> list[Tag | None]:
        assert tag_search is not None
        steps = quads.contrasts[indices].mean(axis=1)
        return decode_tags(grey, scale * quads.sides[indices], steps, tag_search)

    # pyrDown keeps every second pixel's centre, so that coordinates only need the factor.
    sides = scale * quads.sides

    def aligned(index: int | None, outer: int) -> Outline | None:
        if index is None:
            return None
        places = alignment(quads.corners[index], quads.corners[outer])
        return Outline.of(sides[index], bool(quads.dark_inside[index]), places)

    squares = []
    for figure in find_framed_squares(smooth, quads, None if tag_search is None else read_tags):
        turns = figure.tag.turns if figure.tag else 0
        outer = Outline.of(sides[figure.outer], bool(quads.dark_inside[figure.outer]), turns)
        inner, adjacent = (aligned(quad, figure.outer) for quad in (figure.inner, figure.adjacent))
        if adjacent is not None and _width_between(outer, adjacent) > WIDEST_BAR:
            adjacent = None
        squares.append(SquareOutline(outer, inner, figure.tag, adjacent=adjacent))
    known, corners = _corners(squares), scale * coarse.corners
    unread = np.flatnonzero(coarse.dark_inside)
    unread = unread[~are_among(corners[unread], known)]
    if len(unread):
        unread = unread[~are_uniform(smooth, coarse.subset(unread))]
    return squares, corners[unread]


def _find_small_tags(
    grey: NDArray[np.uint8], found: list[SquareOutline], names: set[str]
) -> list[SquareOutline]:
    """Find tags too small for the working picture, of the dictionaries that are present.

    OpenCV's detector needs the name of a dictionary, which other tags have given.
    """
    small_tags: list[SquareOutline] = []
    tagged = [square for square in found if square.tag is not None]
    for name in sorted(names):
        markers, _ = detect_markers(grey, name)
        corners = refined_corners(grey, np.array([marker.corners for marker in markers]))
        search = TagSearch((name,), stated=True)
        tags = decode_tags(grey, straight_sides(corners), np.zeros(len(corners)), search)
        for quad, tag in zip(corners, tags, strict=True):
            if tag is not None and not is_among(quad, _corners([*tagged, *small_tags])):
                tag_corners = np.roll(quad, tag.turns, axis=0)
                (ends,) = straight_sides(tag_corners[None])
                small_tags.append(SquareOutline(Outline.of(ends, dark_inside=True), None, tag))
    if not small_tags:
        return []
    sizes = sorted(_side(square.outer) for square in (*found, *small_tags))
    smallest = MIN_RELATIVE_SIDE * sizes[-3] if len(sizes) > 3 else 0.0
    return [square for square in small_tags if _side(square.outer) >= smallest]


def _width_between(outer: Outline, inner: Outline) -> float:
    """Width of the narrowest bar of a frame, pixels."""
    middles = [
        np.array([side.mean(axis=0) for side in outline.sides]) for outline in (outer, inner)
    ]
    return float(np.linalg.norm(middles[0] - middles[1], axis=1).min())


def _corners(squares: Sequence[SquareOutline]) -> FloatArray:
    """Corners of squares' outer outlines, shape (N, 4, 2)."""
    return np.array([square.outer.corners for square in squares]).reshape(-1, 4, 2)


def _side(outline: Outline) -> float:
    """Mean length of the sides' chords, pixels."""
    along = outline.corners - np.roll(outline.corners, 1, axis=0)
    return float(np.linalg.norm(along, axis=1).mean())
