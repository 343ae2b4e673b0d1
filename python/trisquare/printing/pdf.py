"""The pages of a printed target as PDF: vectors, in millimetres.

Drawn by reportlab, the extra `trisquare[target]`: of the two well-maintained libraries that need
nothing but Pillow and the like, it is the one under a permissive licence, it writes coordinates to
a millionth of a point, and the same target always gives the same bytes.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trisquare.printing.layout import RULER, UNPRINTABLE, Point, TargetPage

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

POINTS_PER_MM = 72.0 / 25.4

THIN = 0.25
"""Line width in millimetres that every printer draws, and that is under a pixel in a photograph."""

FOLD_GREY, TAB_GREY = 0.6, 0.88
"""Grey of the folds, which cross the paper near the frames and must not count as edges, and of the
drawing; and grey of the tab."""

DASHES = (3.0, 2.0)
"""Lengths of line and of gap along a fold, millimetres."""

TICK_STEP, LABEL_STEP = 10.0, 50.0
TICK, LONG_TICK = 2.5, 5.0
"""Distances and lengths of the ruler's marks, millimetres: every centimetre, longer at its
labels."""

FONT, FONT_POINTS = "Helvetica", 10.0
"""A font that every PDF viewer has; at this size the longest line of text fits every page."""

LABEL_DROP, RULER_TO_TEXT, LINE_DROP = 5.0, 13.0, 5.5
"""Baselines below the ruler (labels, first line of text), and distance from line to line, mm."""

TEXT_INDENT = 3.0
"""Distance of the text from the border that printers leave white, millimetres."""

TAB_TEXT = "TAB: glue here"

EVEN_ODD = 0
"""reportlab's FILL_EVEN_ODD: a square within a square is a hole."""


def pdf_of(pages: Sequence[TargetPage], title: str, author: str) -> bytes:
    """Return a PDF of the pages.

    Raises
    ------
    ImportError
        If reportlab is not installed.
    """
    try:
        from reportlab.pdfgen.canvas import Canvas
    except ImportError as error:
        raise ImportError(
            "printing a target needs reportlab: pip install 'trisquare[target]'"
        ) from error
    stream = io.BytesIO()
    canvas = Canvas(stream, pagesize=_points(pages[0].size), invariant=1)
    canvas.setTitle(title)
    canvas.setAuthor(author)
    # Viewers that support this print at 100 % by default.
    canvas.setViewerPreference("PrintScaling", "None")
    for page in pages:
        _draw(canvas, page)
        canvas.showPage()
    canvas.save()
    return stream.getvalue()


def _points(size: tuple[float, float]) -> tuple[float, float]:
    return size[0] * POINTS_PER_MM, size[1] * POINTS_PER_MM


def _draw(canvas: Canvas, page: TargetPage) -> None:
    canvas.setPageSize(_points(page.size))
    # From here on millimetres from the upper left corner, y down.
    canvas.translate(0.0, page.size[1] * POINTS_PER_MM)
    canvas.scale(POINTS_PER_MM, -POINTS_PER_MM)
    if page.tab:
        canvas.setFillGray(TAB_GREY)
        _fill(canvas, [page.tab])
    canvas.setFillGray(0.0)
    for frame in page.frames:
        _fill(canvas, frame.outlines().tolist())
    canvas.setLineWidth(THIN)
    canvas.setStrokeGray(FOLD_GREY)
    canvas.setDash(DASHES)
    canvas.lines([(*start, *end) for start, end in page.folds])
    canvas.setDash()
    canvas.lines([(*start, *end) for start, end in page.drawing])
    canvas.setStrokeGray(0.0)
    canvas.lines([(*start, *end) for start, end in page.cuts])
    _draw_ruler(canvas, page.ruler)
    if page.apex is not None:
        x, y = (centre + 0.5 * page.face for centre in page.apex)
        _write(canvas, (x, y), TAB_TEXT, centred=True)
    left, top = UNPRINTABLE + TEXT_INDENT, page.ruler[1] + RULER_TO_TEXT
    for number, line in enumerate(page.text):
        _write(canvas, (left, top + number * LINE_DROP), line)


def _fill(canvas: Canvas, outlines: Iterable[Sequence[Point]]) -> None:
    path = canvas.beginPath()
    for start, *rest in outlines:
        path.moveTo(*start)
        for point in rest:
            path.lineTo(*point)
        path.close()
    canvas.drawPath(path, stroke=0, fill=1, fillMode=EVEN_ODD)


def _draw_ruler(canvas: Canvas, start: Point) -> None:
    x, y = start
    canvas.line(x, y, x + RULER, y)
    for position in np.arange(0.0, RULER + 0.5 * TICK_STEP, TICK_STEP).tolist():
        labelled = position % LABEL_STEP == 0.0
        canvas.line(x + position, y, x + position, y - (LONG_TICK if labelled else TICK))
        if labelled:
            unit = " mm" if position == RULER else ""
            _write(canvas, (x + position, y + LABEL_DROP), f"{position:g}{unit}", centred=True)


def _write(canvas: Canvas, at: Point, text: str, *, centred: bool = False) -> None:
    """Write upright text with its baseline beginning at a point, or centred there."""
    canvas.saveState()
    canvas.translate(*at)
    canvas.scale(1.0 / POINTS_PER_MM, -1.0 / POINTS_PER_MM)
    canvas.setFillGray(0.0)
    canvas.setFont(FONT, FONT_POINTS)
    (canvas.drawCentredString if centred else canvas.drawString)(0.0, 0.0, text)
    canvas.restoreState()
