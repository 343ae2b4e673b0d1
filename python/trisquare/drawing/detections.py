"""A photograph with the targets found in it, and those rejected with the reasons."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.drawing.canvas import (
    Box,
    Canvas,
    Colour,
    dimmed_grey,
    draw_legend,
    draw_lines,
    text_scale,
    text_size,
    write_lines,
)
from trisquare.images.pixels import Image
from trisquare.results.partial_detection import PartialDetection
from trisquare.results.plane import Plane
from trisquare.results.rejected import Rejected

FOUND_COLOUR: Colour = (90, 230, 90)
REJECTED_COLOUR: Colour = (70, 120, 255)

READABLE_SIZE = 1200
"""Longer side, in pixels, below which the picture is enlarged so that labels do not cover it."""

MAX_ENLARGED = 8

LABEL_WIDTH = 26
"""Maximum number of characters in a line of a label."""

LINE_SPACING = 1.6
"""Distance of a label's lines, over the height of a letter."""

INSIDE = 0.8
"""Maximum size of a label within a quad, over the quad's extent, so that it does not hide it."""

RINGS = 3
"""Number of rings of places around a quad, a label's size apart: farther away, a label would not be
seen with its quad."""


def draw_detections(
    image: Image,
    found: Sequence[Plane | PartialDetection],
    rejected: Sequence[Rejected],
    *,
    index: int = 0,
) -> Canvas:
    """Draw where targets were found, and each rejected shape with the reason.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR; float pictures are taken to span 0 to 1.
    found : sequence of Plane or PartialDetection
        Targets drawn as accepted, numbered: ``result.planes``, or the ``found`` of an error. A
        plane with a reason for its rejection is drawn as rejected.
    rejected : sequence of Rejected
        Shapes drawn as rejected.
    index : int
        Index of this picture; detections in others are omitted.

    Returns
    -------
    ndarray of uint8, shape (k H, k W, 3)
        BGR; k is 1 except for pictures so small that labels would cover them.
    """
    scale = int(np.clip(np.ceil(READABLE_SIZE / max(image.shape[:2])), 1, MAX_ENLARGED))
    canvas = np.repeat(np.repeat(dimmed_grey(image), scale, axis=0), scale, axis=1)
    labels = []
    for number, target in enumerate(found):
        if target.image == index:
            rejection = target.rejection if isinstance(target, Plane) else None
            colour = FOUND_COLOUR if rejection is None else REJECTED_COLOUR
            text = f"{number} {target.kind}" + (f": {rejection}" if rejection else "")
            labels.append((text, colour, _enlarged(target.corners, scale)))
    for candidate in rejected:
        if candidate.image == index:
            residual = "" if candidate.residual is None else f", {candidate.residual:.2g} px"
            text = f"{candidate.kind}: {candidate.reason}{residual}"
            labels.append((text, REJECTED_COLOUR, _enlarged(candidate.corners, scale)))
    accepted = sum(colour == FOUND_COLOUR for _, colour, _ in labels)
    entries = [
        (f"found: {accepted}", FOUND_COLOUR),
        (f"not used: {len(labels) - accepted}", REJECTED_COLOUR),
    ]
    quads = [corners for _, _, corners in labels]
    used_boxes = [draw_legend(canvas, entries, np.vstack([np.empty((0, 2)), *quads]))]
    size = text_scale(canvas)
    letter = text_size("Xg", size)[1]
    for text, colour, corners in labels:
        lines = textwrap.wrap(text, LABEL_WIDTH)
        box = _label_box(canvas, lines, corners, used_boxes)
        used_boxes.append(box)
        entries = [(line, colour) for line in lines]
        write_lines(canvas, box, entries, LINE_SPACING * letter, (0.5 * letter, 0.0), size)
    thickness = max(1, round(max(canvas.shape) / 1000))
    # Targets that were found are drawn last, over the rest.
    for _, colour, corners in reversed(labels):
        width = 3 * thickness if colour == FOUND_COLOUR else thickness
        draw_lines(canvas, [corners[[0, 1, 2, 3, 0]]], colour, width)
    return canvas


def _enlarged(corners: FloatArray, scale: int) -> FloatArray:
    """Return pixels of the enlarged picture: a pixel's centre becomes that of its block."""
    return np.asarray(scale * corners + 0.5 * (scale - 1))


def _label_box(
    canvas: Canvas, lines: Sequence[str], corners: FloatArray, used_boxes: Sequence[Box]
) -> Box:
    """Find the place for a label in or beside a quad (4, 2) with the least overlap with others."""
    scale = text_scale(canvas)
    letter = text_size("Xg", scale)[1]
    width = max(text_size(line, scale)[0] for line in lines) + letter
    size = np.array([width, LINE_SPACING * letter * len(lines)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = 0.5 * (low + high - size)
    places = []
    for ring in range(RINGS):
        left, above = low - letter - (1 + ring) * size
        right, below = high + letter + ring * size
        x, y = middle
        places += [(x, below), (x, above), (right, y), (left, y)]
        places += [(right, below), (left, below), (right, above), (left, above)]
    fits_inside = bool(np.all(size < INSIDE * (high - low)))
    places.insert(0 if fits_inside else len(places), (middle[0], middle[1]))
    largest = np.maximum(np.array(canvas.shape[1::-1]) - size, 0.0)
    starts = np.clip(places, 0.0, largest)
    occupied = np.array(used_boxes)
    overlaps = np.minimum((starts + size)[:, None], occupied[:, 2:]) - np.maximum(
        starts[:, None], occupied[:, :2]
    )
    overlap = np.maximum(overlaps, 0.0).prod(axis=2).sum(axis=1)
    x, y = starts[int(np.argmin(overlap))].tolist()
    return x, y, x + float(size[0]), y + float(size[1])
