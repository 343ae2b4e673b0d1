"""A photograph with the edges that were taken for straight lines, and the rejected ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.drawing.canvas import Canvas, Colour, dimmed_grey, draw_legend, draw_lines
from trisquare.images.pixels import Image

USED: Colour = (80, 220, 60)
REJECTED: Colour = (60, 60, 240)


def draw_straight_lines(
    image: Image, used: Sequence[FloatArray], rejected: Sequence[FloatArray], caption: str
) -> Canvas:
    """Draw used lines in green and rejected ones in red, each of shape (N, 2), in pixels."""
    canvas = dimmed_grey(image)
    entries = draw_used_and_rejected(canvas, used, rejected, f": {caption}")
    points = np.concatenate([*used, *rejected]) if used or rejected else np.zeros((0, 2))
    draw_legend(canvas, entries, points)
    return canvas


def draw_used_and_rejected(
    canvas: Canvas, used: Sequence[FloatArray], rejected: Sequence[FloatArray], caption: str
) -> list[tuple[str, Colour]]:
    """Draw lines into a picture as `draw_straight_lines` does, and return the legend's entries."""
    thickness = max(1, round(max(canvas.shape) / 1000))
    draw_lines(canvas, rejected, REJECTED, thickness)
    draw_lines(canvas, used, USED, thickness)
    return [
        (f"{len(used)} straight lines{caption}", USED),
        (f"{len(rejected)} edges rejected", REJECTED),
    ]
