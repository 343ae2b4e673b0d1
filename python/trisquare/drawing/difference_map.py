"""A picture of the distance between the projections of two cameras."""

from __future__ import annotations

import textwrap
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.analysis.comparison import Comparison, two_digits
from trisquare.drawing.canvas import (
    Canvas,
    Colour,
    draw_label,
    draw_lines,
    draw_text,
    text_scale,
    text_size,
)

LONGEST_SIDE = 1200
"""Longer side of the map, pixels: large enough for its text, whatever the size of the cameras'
pictures."""

BAR_WIDTH = 0.03
"""Width of the colour bar, over that of the map."""

BAR_STEPS = 4
"""Number of labels along the colour bar, less one."""

ARROWS_ACROSS = 16
"""Number of columns of arrows: farther apart than they are long, near enough to show the shape."""

TEXT_COLOUR: Colour = (240, 240, 240)
ARROW_COLOUR: Colour = (255, 255, 255)
UNKNOWN_COLOUR: Colour = (90, 90, 90)
GROUND_COLOUR: Colour = (30, 30, 30)


def draw_comparison(comparison: Comparison) -> Canvas:
    """Draw the distances in colour, and the differences as exaggerated arrows.

    Beside it is the scale of the colours in pixels, below it the verdict. Grey marks where one of
    the two cameras has no projection.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)
        BGR; the map is `LONGEST_SIDE` pixels on its longer side.
    """
    width, height = comparison.first.image_size
    shrink = LONGEST_SIDE / max(width, height)
    size = (max(round(width * shrink), 1), max(round(height * shrink), 1))
    distance = comparison.distance
    is_known = np.isfinite(distance)
    worst = max(comparison.worst, np.finfo(float).tiny)
    level = _enlarged(np.where(is_known, distance, 0.0) / worst, size, cv2.INTER_LINEAR)
    chart = _viridis(255 * level)
    chart[_enlarged(is_known, size, cv2.INTER_NEAREST) < 0.5] = UNKNOWN_COLOUR
    _draw_arrows(chart, comparison)
    return _framed(chart, comparison)


def _viridis(shades: FloatArray) -> Canvas:
    colours = cv2.applyColorMap(np.rint(shades).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return np.asarray(colours, dtype=np.uint8)


def _enlarged(grid: npt.NDArray[Any], size: tuple[int, int], interpolation: int) -> FloatArray:
    """Interpolate values on a grid from border to border."""
    rows, columns = grid.shape
    x = np.linspace(0, columns - 1, size[0], dtype=np.float32)
    y = np.linspace(0, rows - 1, size[1], dtype=np.float32)
    map_x, map_y = np.meshgrid(x, y)
    return np.asarray(cv2.remap(grid.astype(np.float32), map_x, map_y, interpolation))


def _draw_arrows(chart: Canvas, comparison: Comparison) -> None:
    """Draw arrows for some of the differences, the largest about as long as they are apart."""
    rows, columns = comparison.distance.shape
    height, width = chart.shape[:2]
    step = max(columns // ARROWS_ACROSS, 1)
    scale = np.array([width, height]) / np.array(comparison.first.image_size)
    length = width / ARROWS_ACROSS / max(comparison.worst, np.finfo(float).tiny)
    for row in range(step // 2, rows, step):
        for column in range(step // 2, columns, step):
            difference = comparison.difference[row, column]
            if not np.all(np.isfinite(difference)):
                continue
            foot = np.array([comparison.x[column], comparison.y[row]]) * scale
            tip = foot + length * difference
            along = 0.25 * (tip - foot)
            across = 0.5 * np.array([-along[1], along[0]])
            head = np.array([tip - along + across, tip, tip - along - across])
            draw_lines(chart, [np.array([foot, tip]), head], ARROW_COLOUR, 1)


def _framed(chart: Canvas, comparison: Comparison) -> Canvas:
    """Put the colour bar to the right and the verdict below."""
    height, width = chart.shape[:2]
    scale = text_scale(chart)
    letter_width, letter = text_size("0", scale)
    bar = max(round(BAR_WIDTH * width), 1)
    letters = len(comparison.verdict) * width // text_size(comparison.verdict, scale)[0]
    lines = textwrap.wrap(
        comparison.verdict, max(letters, 1), break_long_words=False, break_on_hyphens=False
    )
    text_height = round(2 * letter * (len(lines) + 0.5))
    canvas = np.full(
        (height + text_height, width + 2 * bar + 8 * letter_width, 3), GROUND_COLOUR, "u1"
    )
    canvas[:height, :width] = chart
    shades = np.linspace(255, 0, height)[:, None].repeat(bar, axis=1)
    canvas[:height, width + bar // 2 : width + bar // 2 + bar] = _viridis(shades)
    for part in np.linspace(0, 1, BAR_STEPS + 1).tolist():
        baseline = np.clip((1 - part) * height + 0.5 * letter, 1.5 * letter, height - 0.5 * letter)
        place = np.array([width + 1.75 * bar, baseline])
        unit = " px" if part == 1 else ""
        draw_text(canvas, f"{two_digits(part * comparison.worst)}{unit}", place, TEXT_COLOUR, scale)
    for number, line in enumerate(lines):
        place = np.array([letter_width, height + 2 * letter * (number + 1)])
        draw_text(canvas, line, place, TEXT_COLOUR, scale)
    x, y = np.array(comparison.worst_at) * [width, height] / comparison.first.image_size
    margin = 4 * letter_width
    position = np.array(
        [np.clip(x, margin, width - margin), np.clip(y, 2 * letter, height - 2 * letter)]
    )
    draw_label(canvas, f"{two_digits(comparison.worst)} px", position, TEXT_COLOUR, scale)
    return canvas
