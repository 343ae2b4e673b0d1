"""Reasons why four-sided shapes of a picture were not taken for squares or rectangles.

The search drops most of them silently. After a failure, for a debug image or for a printed table,
its stages are run again, and each shape that a stage drops is reported; `calibrate` of Python does
not spend this time.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas
from trisquare.detection.candidates import MIN_CONTRAST
from trisquare.detection.grey import MIN_PICTURE, RANGE_PERCENTILES
from trisquare.detection.squares.framed import find_framed_squares, reasons_against_quads
from trisquare.detection.squares.quads import (
    BORDER,
    SAME_QUAD_FRACTION,
    SAME_QUAD_PIXELS,
    Quads,
    find_quads,
    is_among,
)
from trisquare.detection.squares.rectified import views_of_rectangles
from trisquare.detection.squares.side_curves import MAX_CORNER_COSINE, fit_sides
from trisquare.measurement.boards import Board
from trisquare.measurement.find import Search
from trisquare.measurement.side_spans import DetectedTarget
from trisquare.results.rejected import CUT_BY_BORDER, Rejected

KIND = "quad"

MAX_REPORTED = 8
"""Maximum number of shapes reported per picture, the largest: more would hide one another."""

MIN_SIDE = 30.0
"""Minimum side, in pixels of the searched picture, the recommended width of a square; smaller
shapes are mostly text."""

BORDER_LEVELS = 10
"""Number of thresholds at which shapes cut by the border are searched; a contrast of a quarter of
the picture's own spans two."""

CUT_CORNERS = range(4, 7)
"""Numbers of corners of a square of which the border cuts off one or two."""

MIN_BOX_FILLING = 0.6
"""Minimum area over that of the bounding rectangle: more than a triangle's."""

MIN_CUT_FILLING = 0.9
"""Minimum area over that of the convex hull: lens and blur leave a square nearly convex."""

MAX_CUT_SHARE = 0.2
"""Maximum area over the picture's: anything larger is the ground."""


def rejection_reasons(search: Search) -> list[Rejected]:
    """Return the four-sided shapes of a searched picture that are not targets, and why.

    The largest come first, at most `MAX_REPORTED`. Shapes within a target that was found are
    omitted, and so are the sheets and signs that targets lie on.
    """
    searched, scale = search.working_picture()
    kinds = search.kinds
    if not (kinds.squares or kinds.rectangles) or min(searched.shape) < MIN_PICTURE:
        return []
    targets = np.array([_region(target) / scale for target in search.targets]).reshape(-1, 4, 2)
    # The search for rectangles has other stages; most shapes that those drop are printed on sheets.
    dropped = _dropped_by_stages(searched) if kinds.squares else ()
    shapes = [
        (corners, reason)
        for corners, reason in (*dropped, *_cut_by_border(searched))
        if quad_areas(corners) >= MIN_SIDE**2 and not is_among(corners, targets)
    ]
    outlines = np.array([corners for corners, _ in shapes]).reshape(-1, 4, 2)
    reported = [
        shape for i, shape in enumerate(shapes) if not _are_same(shape[0], outlines[:i]).any()
    ]
    reported.sort(key=lambda shape: -float(quad_areas(shape[0])))
    return [
        Rejected(KIND, 0, scale * corners, reason) for corners, reason in reported[:MAX_REPORTED]
    ]


def _region(target: DetectedTarget) -> FloatArray:
    """Return a quad (4, 2) that encloses a target, a board's outer cells included, pixels."""
    if not isinstance(target, Board):
        return target.quad
    middle = target.quad.mean(axis=0)
    cells = max(min(target.lattice.present.shape) - 1, 1)
    return np.asarray(middle + (1.0 + 2.0 / cells) * (target.quad - middle))


def _dropped_by_stages(picture: NDArray[np.uint8]) -> Iterator[tuple[FloatArray, str]]:
    """Yield corners (4, 2) of the quads that each stage of `find_squares` drops, and why."""
    smooth = picture.astype(np.float32)
    rough = find_quads(picture, smooth)
    fitted = fit_sides(picture, rough)
    views = views_of_rectangles(fitted, image_size=(picture.shape[1], picture.shape[0]))
    squares = find_framed_squares(smooth, views)
    used_indices = {index for square in squares for index in (square.outer, square.inner)}
    unused = views.subset(np.array([i not in used_indices for i in range(len(views))], bool))
    yield from zip(unused.corners, reasons_against_quads(smooth, unused), strict=True)
    for corners in _dropped(fitted, views):
        yield (
            corners,
            "no camera sees a square like this: something may lie across it; a sheet of paper has "
            'to be named (targets="a4")',
        )
    for corners in _dropped(rough, fitted):
        along = np.roll(corners, -1, axis=0) - corners
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        cosines = np.abs((along * np.roll(along, 1, axis=0)).sum(axis=1))
        is_flat = cosines.max() > MAX_CORNER_COSINE
        yield (
            corners,
            "it is seen at too flat an angle"
            if is_flat
            else "one of its sides is not a smooth edge",
        )


def _dropped(before: Quads, after: Quads) -> list[FloatArray]:
    """Return corners of the quads that a stage dropped and that are large enough to be reported."""
    large = before.corners[before.areas >= MIN_SIDE**2]
    return [corners for corners in large if not _are_same(corners, after.corners).any()]


def _cut_by_border(picture: NDArray[np.uint8]) -> Iterator[tuple[FloatArray, str]]:
    """Yield the bounding rectangles of regions that may be squares cut by the border."""
    darkest, brightest = np.percentile(picture, RANGE_PERCENTILES)
    if brightest - darkest < MIN_CONTRAST:
        return
    for kind in (cv2.THRESH_BINARY, cv2.THRESH_BINARY_INV):
        previous_boxes = np.empty((0, 4, 2))
        for share in (np.arange(BORDER_LEVELS) + 0.5) / BORDER_LEVELS:
            level = darkest + share * (brightest - darkest)
            mask = cv2.threshold(picture, level, 255, kind)[1]
            contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
            cut_contours = [c for c in contours if _may_be_cut_square(c, picture.shape)]
            boxes = np.array([cv2.boxPoints(cv2.minAreaRect(c)) for c in cut_contours], float)
            boxes = boxes.reshape(-1, 4, 2)
            # An edge stays where it is from one level to the next; a shadow's rim does not.
            for box in boxes:
                if _are_same(box, previous_boxes).any():
                    yield box, CUT_BY_BORDER
            previous_boxes = boxes


def _may_be_cut_square(contour: cv2.typing.MatLike, shape: tuple[int, ...]) -> bool:
    """Return whether a contour reaches the border at one side or corner, and has few corners."""
    height, width = shape
    x, y, box_width, box_height = cv2.boundingRect(contour)
    is_near = [(gap < BORDER) for gap in (x, width - x - box_width, y, height - y - box_height)]
    area = cv2.contourArea(contour)
    if (
        not any(is_near)
        or (is_near[0] and is_near[1])
        or (is_near[2] and is_near[3])
        or not MIN_SIDE**2 <= area <= MAX_CUT_SHARE * width * height
    ):
        return False
    hull = cv2.convexHull(contour)
    box = cv2.boxPoints(cv2.minAreaRect(contour))
    if area < max(MIN_CUT_FILLING * cv2.contourArea(hull), MIN_BOX_FILLING * cv2.contourArea(box)):
        return False
    corners = cv2.approxPolyDP(hull, 0.02 * cv2.arcLength(hull, closed=True), closed=True)
    return len(corners) in CUT_CORNERS


def _are_same(corners: FloatArray, others: FloatArray) -> NDArray[np.bool_]:
    """Return which quads, shape (N, 4, 2), have the middle and the size of one, (4, 2)."""
    size, sizes = np.sqrt(quad_areas(corners)), np.sqrt(quad_areas(others))
    gaps = np.abs(others.mean(axis=1) - corners.mean(axis=0)).max(axis=1)
    tolerance = 2.0 * (SAME_QUAD_PIXELS + SAME_QUAD_FRACTION * size)
    return np.asarray(np.maximum(gaps, np.abs(sizes - size)) < tolerance)
