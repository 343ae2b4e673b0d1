"""Layout of the pages of a printed target: millimetres, from the upper left.

The corner's sheet is a square of four faces round one point, the apex: three carry a figure, and
the fourth, cut from its left neighbour and glued behind it, closes the corner::

    +---+---+
    | 0 | 1 |      fold between 0 and 1, 0 and 2, 1 and the tab
    +---+---+
    | 2 |tab|      cut between 2 and the tab
    +---+---+
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.printing.folding import seen_from_front

Point: TypeAlias = tuple[float, float]
Line: TypeAlias = tuple[Point, Point]
Kind: TypeAlias = Literal["flat", "corner"]

PAGES: Mapping[str, Point] = MappingProxyType(
    {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}
)
"""Width and height of the pages, upright: ISO 216 and ANSI A."""

INNER = 0.6
"""Side of a frame's hole, over its own side. Predicted (benchmarks/printed_target.py), 0.4 or 0.8
would change the std of f by 5 %, and 0.8 would raise that of k1 by a third; at 0.6 the band is
wider than the light margin, which is therefore the limit."""

MARGIN = 0.12
"""Minimum light margin round a frame, over its side. With 0.06 a photograph would determine the
focal length 10 % better; but in one of 640 x 480 pixels, where the corner's faces are foreshortened
by half, that is 4 pixels, the reach of an edge's blur. With 0.12 it is 9."""

UNPRINTABLE = 7.0
"""Border of the paper that printers leave white, millimetres: slightly more than a quarter inch."""

CELLS = 18
"""Number of cells of a printed board along a side. Even, so that a half turn is its only
symmetry."""

MIN_SIDE = 10.0
"""Minimum side, millimetres: the raggedness of a printed edge, some 0.05 mm, is then half a per
cent."""

SLIVER = 10.0
"""Maximum width of paper beyond the faces that is left on them, millimetres: too narrow to cut off
well, and a cutting line so near the paper's border is not printed everywhere."""

TAB_TAPER = 5.0
"""Millimetres by which the tab is smaller than the face it is glued to, so that it stays behind
it."""

RULER = 100.0
"""Length of the check ruler, millimetres."""

RULER_DROP = 16.0
"""Distance of the ruler below the faces, millimetres: its print stays clear of the frames."""

DRAWING, DRAWING_DROP = 21.0, 3.0
"""Maximum height and width of the drawing of the folded corner, and its distance below the faces,
mm: right of the ruler, above the text, with a gap of 2 mm about it."""

VIEWER = 4.0
"""Distance from the apex to the drawing's viewpoint, in faces: about as far as a photograph is
taken."""

CELLS_DRAWN = 6
"""Number of a board's cells along a side in the drawing: all of them would be 0.5 mm wide."""

FRAMES_OF_CORNER = ((-1, -1), (1, -1), (-1, 1))
"""The quadrants about the apex that carry a figure; y down."""

CORNER_TEXT = (
    "1. Print at 100 % and check the ruler. Cut along the solid lines. Fold along the dashed ones "
    "to right angles, print inside.",
    "2. Glue the grey tab to the back of the face on its left. Let the three faces fill the "
    "photograph, seen from the front.",
)
FLAT_TEXT = (
    "1. Print all three sheets at 100 %, check the ruler, glue each flat on stiff cardboard; keep "
    "the margin white.",
    "2. Stand them up, tilted 25-50 degrees, each in another direction, and let them fill the "
    "photograph.",
)


@dataclass(frozen=True, slots=True)
class PrintedFrame:
    """A dark square with a square hole, on paper.

    Attributes
    ----------
    centre : (float, float)
        Millimetres from the page's upper left corner, x right, y down.
    side : float
        Side of the outer square, millimetres.
    inner : float
        Side of the hole, over `side`.
    """

    centre: Point
    side: float
    inner: float = INNER

    def outlines(self) -> FloatArray:
        """Return corners of square and hole, clockwise from the upper left, mm, (2, 4, 2)."""
        unit = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        sides = self.side * np.array([1.0, self.inner])
        outlines: FloatArray = np.asarray(self.centre) + sides[:, None, None] * unit
        return outlines

    def drawn_lines(self) -> FloatArray:
        """Return the ends of the lines that show it in a drawing, mm, shape (8, 2, 2)."""
        outlines = self.outlines()
        return np.stack([outlines, np.roll(outlines, -1, axis=1)], axis=2).reshape(-1, 2, 2)


@dataclass(frozen=True, slots=True)
class PrintedBoard:
    """A square chessboard on paper.

    Attributes
    ----------
    centre : (float, float)
        Millimetres from the page's upper left corner, x right, y down.
    side : float
        Side of the whole board, millimetres.
    cells : int
        Number of cells along a side; the upper left one is dark.
    """

    centre: Point
    side: float
    cells: int = CELLS

    def outlines(self) -> FloatArray:
        """Return corners of the dark cells, clockwise from the upper left, mm, shape (N, 4, 2)."""
        row, column = np.indices((self.cells, self.cells))
        dark = (row + column) % 2 == 0
        first = np.column_stack([column[dark], row[dark]])
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        in_cells = first[:, None] + unit - 0.5 * self.cells
        outlines: FloatArray = np.asarray(self.centre) + self.side / self.cells * in_cells
        return outlines

    def drawn_lines(self) -> FloatArray:
        """Return the ends of the lines that show it in a drawing, mm, shape (N, 2, 2)."""
        positions = self.side * np.linspace(-0.5, 0.5, CELLS_DRAWN + 1)
        ends = np.broadcast_to([positions[0], positions[-1]], (len(positions), 2))
        across = np.stack([ends, np.repeat(positions[:, None], 2, axis=1)], axis=2)
        lines: FloatArray = np.asarray(self.centre) + np.concatenate([across, across[..., ::-1]])
        return lines


PrintedFigure: TypeAlias = PrintedFrame | PrintedBoard


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPage:
    """One page of a printed target; all in millimetres from its upper left corner.

    Attributes
    ----------
    kind : {"flat", "corner"}
    size : (float, float)
        Width and height of the paper.
    frames : tuple of PrintedFrame or PrintedBoard
        One, or the three of a corner: upper left, upper right, lower left.
    face : float
        Side of the square part of the paper in whose middle each frame is.
    apex : (float, float), optional
        Where a corner's faces meet.
    folds, cuts : tuple of lines
        Ends of each line.
    tab : tuple of points
        Outline of the part that is glued behind; empty on a flat page.
    drawing : tuple of lines
        The folded corner as seen from the front; empty on a flat page.
    ruler : (float, float)
        Left end of the check ruler.
    text : tuple of str
        Lines of text below the ruler.
    """

    kind: Kind
    size: Point
    frames: tuple[PrintedFigure, ...]
    face: float
    apex: Point | None = None
    folds: tuple[Line, ...] = ()
    cuts: tuple[Line, ...] = ()
    tab: tuple[Point, ...] = ()
    drawing: tuple[Line, ...] = ()
    ruler: Point
    text: tuple[str, ...]


MARGINS: Mapping[type[PrintedFigure], tuple[float, str]] = MappingProxyType(
    {PrintedFrame: (MARGIN, "frames"), PrintedBoard: (1.0 / CELLS, "chessboards")}
)
"""Minimum light margin round a figure, over its side, and the figures' name. A board's is one cell:
every second cell at its border is light already."""


def flat_pages(page: str, side: float | None) -> list[TargetPage]:
    """Lay out three pages with one frame each.

    Parameters
    ----------
    page : str
        One of `PAGES`.
    side : float, optional
        Side of the frames, millimetres; by default the largest whole number that fits.

    Raises
    ------
    TypeError, ValueError
        If the page is too small for the side, or the side is too small to be printed.
    """
    size = PAGES[page]
    width = size[0]
    length = _checked_side(side, width, MARGIN, f"one frame on {page}")
    # In the middle of a square at the page's top, as wide as the page.
    frame = PrintedFrame((0.5 * width, 0.5 * width), length)
    return [
        TargetPage(
            kind="flat",
            size=size,
            frames=(frame,),
            face=width,
            ruler=(0.5 * (width - RULER), width + RULER_DROP),
            text=(_heading(page, frame, f"flat target, frame {number} of 3"), *FLAT_TEXT),
        )
        for number in (1, 2, 3)
    ]


def corner_page(
    page: str, side: float | None, figure: type[PrintedFigure] = PrintedFrame
) -> TargetPage:
    """Lay out the sheet that folds into a corner of three planes; see `flat_pages`."""
    size = PAGES[page]
    width = size[0]
    margin, description = MARGINS[figure]
    length = _checked_side(side, 0.5 * width, margin, f"a corner of three {description} on {page}")
    needed = length + 2.0 * max(margin * length, UNPRINTABLE)
    face = 0.5 * width if 0.5 * width - needed < SLIVER else needed
    x, y = apex = (0.5 * width, face)
    left, right, bottom = x - face, x + face, y + face
    frames = tuple(
        figure((x + 0.5 * across * face, y + 0.5 * down * face), length)
        for across, down in FRAMES_OF_CORNER
    )
    tab = (
        apex,
        (right, y),
        (right - TAB_TAPER, bottom - TAB_TAPER),
        (x + TAB_TAPER, bottom - TAB_TAPER),
    )
    cuts = [(apex, (x, bottom)), ((left, bottom), (x, bottom))]
    cuts += [(tab[1], tab[2]), (tab[2], tab[3]), (tab[3], apex)]
    if left > 0.0:  # else the paper ends there
        cuts += [((left, 0.0), (left, bottom)), ((right, 0.0), (right, y))]
    return TargetPage(
        kind="corner",
        size=size,
        frames=frames,
        face=face,
        apex=apex,
        folds=(((x, 0.0), apex), ((left, y), apex), (apex, (right, y))),
        cuts=tuple(cuts),
        tab=tab,
        drawing=_folded_drawing(frames, apex, face, size),
        ruler=(0.5 * (width - RULER), bottom + RULER_DROP),
        text=(_heading(page, frames[0], "corner target"), *CORNER_TEXT),
    )


def _folded_drawing(
    figures: tuple[PrintedFigure, ...], apex: Point, face: float, size: Point
) -> tuple[Line, ...]:
    """Draw the folded corner, at the right end of the room between the faces and the text."""
    outline = face * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    edges = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    seen = np.concatenate(
        [
            seen_from_front(lines, number, VIEWER * face)
            for number, (quadrant, figure) in enumerate(zip(FRAMES_OF_CORNER, figures, strict=True))
            for lines in (edges * quadrant, figure.drawn_lines() - apex)
        ]
    )
    low, high = seen.min(axis=(0, 1)), seen.max(axis=(0, 1))
    scale = DRAWING / np.max(high - low)
    corner = (size[0] - UNPRINTABLE, apex[1] + face + DRAWING_DROP + DRAWING)
    placed = np.asarray(corner) + scale * (seen - high)
    return tuple((tuple(start), tuple(end)) for start, end in placed.tolist())


def _checked_side(side: float | None, room: float, margin: float, what: str) -> float:
    """Return the side of figures that have `room` millimetres each, their margins included."""
    largest = float(np.floor(min(room / (1.0 + 2.0 * margin), room - 2.0 * UNPRINTABLE)))
    if side is None:
        return largest
    if side > largest:
        raise ValueError(
            f"the page is too small: {what} can be {largest:g} mm wide with its light margin, "
            f"not {side:g} mm"
        )
    if side < MIN_SIDE:
        raise ValueError(f"side must be at least {MIN_SIDE:g} mm, not {side:g} mm")
    return side


def _heading(page: str, figure: PrintedFigure, what: str) -> str:
    return f"trisquare: {what}, {page}, {described(figure)}"


def described(figure: PrintedFigure) -> str:
    """Describe the size of a figure."""
    if isinstance(figure, PrintedBoard):
        return f"side {figure.side:g} mm, {figure.cells} x {figure.cells} cells"
    return f"side {figure.side:g} mm, hole {figure.inner * figure.side:g} mm"
