"""Labels beside what they are about, over one another as little as can be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.drawing.canvas import Box, Canvas, Colour, darken, draw_text, text_scale, text_size

LABEL_WIDTH = 26
"""Characters in a line of a label."""

LINE_SPACING = 1.6
"""Of a label's lines, over the height of a letter."""

ROOM_INSIDE = 0.8
"""Of a quad's extent, that a label within it may take: lest it hide what it is about."""

RINGS = 3
"""Labels farther than two others away from what they are about would be lost."""


class Label(NamedTuple):
    """A text in lines, and where it goes."""

    lines: list[str]
    colour: Colour
    box: Box


def placed_label(
    canvas: Canvas, text: str, colour: Colour, corners: FloatArray, taken: Sequence[Box]
) -> Label:
    """Find a place for a text at a quad (4, 2), where it covers the least of what is taken."""
    lines = _wrapped(text)
    scale = text_scale(canvas)
    letter = text_size("Xg", scale)[1]
    width = max(text_size(line, scale)[0] for line in lines) + letter
    height = LINE_SPACING * letter * len(lines)
    margin = np.maximum(np.array(canvas.shape[1::-1]) - [width, height], 0.0)
    boxes: list[Box] = [
        (float(x), float(y), float(x + width), float(y + height))
        for x, y in np.clip(_positions(corners, width, height, letter), 0.0, margin)
    ]
    covered = [sum(_overlap(box, other) for other in taken) for box in boxes]
    return Label(lines, colour, boxes[int(np.argmin(covered))])


def draw_labels(canvas: Canvas, labels: Sequence[Label]) -> None:
    """Write labels on darkened grounds."""
    scale = text_scale(canvas)
    letter = text_size("Xg", scale)[1]
    for label in labels:
        darken(canvas, label.box)
        for number, line in enumerate(label.lines):
            baseline = label.box[1] + (number + 0.75) * LINE_SPACING * letter
            place = np.array([label.box[0] + 0.5 * letter, baseline])
            draw_text(canvas, line, place, label.colour, scale)


def _wrapped(text: str) -> list[str]:
    """Break a text between words into lines of about `LABEL_WIDTH` characters."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + len(word) >= LABEL_WIDTH:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def _positions(corners: FloatArray, width: float, height: float, gap: float) -> FloatArray:
    """Top left corners for a label, (P, 2), in order of preference: in a quad, or just beside."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = 0.5 * (low + high - [width, height])
    beside = []
    for ring in range(RINGS):
        left, right = low[0] - gap - (1 + ring) * width, high[0] + gap + ring * width
        above, below = low[1] - gap - (1 + ring) * height, high[1] + gap + ring * height
        beside += [[x, below], [x, above], [right, y], [left, y]]
        beside += [[right, below], [left, below], [right, above], [left, above]]
    fits = bool(np.all(np.array([width, height]) < ROOM_INSIDE * (high - low)))
    return np.array([[x, y], *beside] if fits else [*beside, [x, y]])


def _overlap(box: Box, other: Box) -> float:
    """Area that two boxes share."""
    width = min(box[2], other[2]) - max(box[0], other[0])
    height = min(box[3], other[3]) - max(box[1], other[1])
    return max(width, 0.0) * max(height, 0.0)
