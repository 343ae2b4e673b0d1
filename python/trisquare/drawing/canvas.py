"""Drawing over photographs: lines to a fraction of a pixel, and readable text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.images.pixels import Image

Canvas: TypeAlias = npt.NDArray[np.uint8]
Colour: TypeAlias = tuple[int, int, int]
"""Blue, green, red."""

Box: TypeAlias = tuple[float, float, float, float]
"""Left, top, right and bottom, pixels."""

OUTLINE_COLOUR: Colour = (20, 20, 20)
DIMMED = 0.55
LEGEND_GROUND = 0.35
# Coordinates are drawn in sixteenths of a pixel: OpenCV's `shift`.
SHIFT = 4
FONT = cv2.FONT_HERSHEY_SIMPLEX


def dimmed_grey(image: Image) -> Canvas:
    """Return a picture in dim grey, as BGR, for drawing on."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    # A file of floating-point numbers may contain NaN.
    if grey.dtype.kind == "u":
        full_scale = np.iinfo(grey.dtype).max
    else:
        grey, full_scale = np.clip(np.nan_to_num(grey), 0, 1), 1
    dimmed = cv2.convertScaleAbs(grey, alpha=255 * DIMMED / full_scale)
    return np.asarray(cv2.cvtColor(dimmed, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _subpixel(points: FloatArray) -> npt.NDArray[np.int32]:
    # Far outside the picture a coordinate may exceed the range of OpenCV's fixed point.
    limit = 2.0**30 / (1 << SHIFT)
    return np.asarray(np.rint(np.clip(points, -limit, limit) * (1 << SHIFT)), dtype=np.int32)


def draw_lines(canvas: Canvas, lines: Sequence[FloatArray], colour: Colour, thickness: int) -> None:
    """Draw polylines, each of shape (N, 2) in pixels."""
    fixed_point = [_subpixel(line).reshape(-1, 1, 2) for line in lines]
    cv2.polylines(canvas, fixed_point, False, colour, thickness, cv2.LINE_AA, SHIFT)


def text_scale(canvas: Canvas) -> float:
    """Return a text size for a canvas, in units of the font's own."""
    return float(max(canvas.shape)) / 2200


def draw_text(
    canvas: Canvas, text: str, position: FloatArray, colour: Colour, scale: float
) -> None:
    """Write a text with its first letter's lower left corner at a position."""
    # Beyond 16 bits the place is far outside the picture, and drawing text there may overflow.
    x, y = (int(value) for value in np.clip(np.rint(position), -32768, 32767))
    cv2.putText(canvas, text, (x, y), FONT, scale, colour, _stroke(scale), cv2.LINE_AA)


def text_size(text: str, scale: float) -> tuple[int, int]:
    """Return the width of a drawn text, and the height of its letters, pixels."""
    width, height = cv2.getTextSize(text, FONT, scale, _stroke(scale))[0]
    return int(width), int(height)


def _stroke(scale: float) -> int:
    """Return the width of the letters' strokes, which widens the text in newer OpenCV versions."""
    return max(1, round(2 * scale))


def draw_label(canvas: Canvas, text: str, centre: FloatArray, colour: Colour, scale: float) -> None:
    """Write a text centred at a point, outlined to be readable on any ground."""
    width, height = text_size(text, scale)
    position = centre + np.array([-width / 2, height / 2])
    outline_width = max(1.0, 2 * scale)
    for shift in outline_width * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]]):
        draw_text(canvas, text, position + shift, OUTLINE_COLOUR, scale)
    draw_text(canvas, text, position, colour, scale)


def draw_legend(
    canvas: Canvas, entries: Sequence[tuple[str, Colour]], points_to_keep: FloatArray
) -> Box:
    """Write the entries on a darkened ground in the emptiest corner, at most half as wide.

    Return its box.
    """
    height, width = canvas.shape[:2]
    scale = text_scale(canvas)
    widest = max(text_size(text, scale)[0] for text, _ in entries)
    scale *= min(1.0, 0.5 * width / max(widest, 1))
    line_height = text_size("Xg", scale)[1] * 1.7
    margin = 0.6 * line_height
    legend_height = min(height, round(len(entries) * line_height + 2 * margin))
    legend_width = min(width, round(min(widest, 0.5 * width) * 1.05 + 2 * margin))
    corners = [(x, y) for y in (0, height - legend_height) for x in (0, width - legend_width)]
    covered = [
        ((points_to_keep >= (x, y)) & (points_to_keep < (x + legend_width, y + legend_height)))
        .all(axis=1)
        .sum()
        for x, y in corners
    ]
    left, top = corners[int(np.argmin(covered))]
    box = (left, top, left + legend_width, top + legend_height)
    write_lines(canvas, box, entries, line_height, (margin, margin), scale)
    return box


def write_lines(
    canvas: Canvas,
    box: Box,
    entries: Sequence[tuple[str, Colour]],
    line_height: float,
    margins: tuple[float, float],
    scale: float,
) -> None:
    """Write lines of text on a darkened ground, with margins to its left and upper border."""
    left, top, right, bottom = (max(round(value), 0) for value in box)
    ground = canvas[top:bottom, left:right]
    ground[:] = (ground * LEGEND_GROUND).astype(np.uint8)
    for number, (text, colour) in enumerate(entries):
        baseline = box[1] + margins[1] + (number + 0.75) * line_height
        draw_text(canvas, text, np.array([box[0] + margins[0], baseline]), colour, scale)
