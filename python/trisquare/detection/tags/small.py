"""Tags that are too small for the picture in which squares are searched for.

In the working picture the sides of a tag of less than 40 pixels are too short to be fitted, but it
shows as a dark quad with something inside. OpenCV's detector reads it in the photograph itself.
That takes a third of the time of a search, so it is run first on the parts where such quads are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Tag
from trisquare.detection.sampling import straight_sides
from trisquare.detection.tags.decode import decode_tags
from trisquare.detection.tags.families import TagSearch
from trisquare.detection.tags.find import detect_markers

MARGIN = 16
"""Pixels of the photograph around a quad: the error of its outline, and the window of the
detector's thresholds."""

MAX_IN_PARTS = 0.25
"""Maximum fraction of the photograph that is searched in parts; beyond, the whole takes no
longer."""

REFINEMENT_REACH = 2
"""Reach on either side of a corner, pixels: the size of the cells of the smallest tags that are
read."""

REFINEMENT_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 10, 0.05)
"""Maximum number of iterations of the corner refinement, and step in pixels at which it stops."""

Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, right and bottom; the last two are exclusive."""


def dictionaries_of_small_tags(
    grey: NDArray[np.uint8], unread: Sequence[FloatArray], search: TagSearch
) -> set[str]:
    """Return the dictionaries of tags that are read in the photograph itself.

    It is searched whole only if a code is among the quads that are `unread`, each of shape (4, 2),
    or if they cover much of it.
    """
    boxes = _boxes_around(unread, grey.shape)
    area = sum((right - left) * (bottom - top) for left, top, right, bottom in boxes)
    if area <= MAX_IN_PARTS * grey.size:
        stated = replace(search, stated=True)
        corners = np.array([quad for box in boxes for quad in _quads(grey, search, box)])
        if not any(_read(grey, refined_corners(grey, corners), stated)):
            return set()
    height, width = grey.shape
    corners = refined_corners(grey, np.array(_quads(grey, search, (0, 0, width, height))))
    return {tag.dictionary for tag in _read(grey, corners, search) if tag is not None}


def refined_corners(grey: NDArray[np.uint8], quads: FloatArray) -> FloatArray:
    """Move corners found by a threshold, if any, onto the nearest image corners, (Q, 4, 2)."""
    if not len(quads):
        return np.zeros((0, 4, 2))
    corners = quads.astype(np.float32).reshape(-1, 1, 2)
    window = (REFINEMENT_REACH, REFINEMENT_REACH)
    moved = cv2.cornerSubPix(grey, corners, window, (-1, -1), REFINEMENT_STOP)
    return np.asarray(moved, dtype=np.float64).reshape(-1, 4, 2)


def _quads(grey: NDArray[np.uint8], search: TagSearch, box: Box) -> list[FloatArray]:
    """Return outlines in a part of the photograph that OpenCV's detector accepts or tries."""
    left, top, right, bottom = box
    part = np.ascontiguousarray(grey[top:bottom, left:right])
    # The detector returns the quads that it cannot read as well: any dictionary will do.
    markers, others = detect_markers(part, search.names[0], longest_side=max(grey.shape))
    corner = np.array([left, top])
    return [corner + quad for quad in [*(marker.corners for marker in markers), *others]]


def _read(grey: NDArray[np.uint8], corners: FloatArray, search: TagSearch) -> list[Tag | None]:
    return decode_tags(grey, straight_sides(corners), np.zeros(len(corners)), search)


def _boxes_around(quads: Sequence[FloatArray], shape: tuple[int, ...]) -> list[Box]:
    """Return boxes that contain quads with their surroundings and do not overlap."""
    height, width = shape
    boxes: list[Box] = []
    for quad in quads:
        low = np.floor(quad.min(axis=0)).astype(int) - MARGIN
        high = np.ceil(quad.max(axis=0)).astype(int) + MARGIN + 1
        box = (max(low[0], 0), max(low[1], 0), min(high[0], width), min(high[1], height))
        while overlapping := [other for other in boxes if _overlap(box, other)]:
            boxes = [other for other in boxes if other not in overlapping]
            lefts, tops, rights, bottoms = zip(box, *overlapping, strict=True)
            box = (min(lefts), min(tops), max(rights), max(bottoms))
        boxes.append(box)
    return boxes


def _overlap(box: Box, other: Box) -> bool:
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]
