"""The edges of a square, a frame, a tag or a rectangle, from its outlines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from trisquare._core import SideSamples, rectangle_lines
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Outline, SquareOutline
from trisquare.detection.tags.codes import dictionary
from trisquare.detection.tags.decode import BORDER
from trisquare.edges import PlaneEdges, unchecked_edges
from trisquare.errors import TrisquareError
from trisquare.measurement.marker_margins import side_margins
from trisquare.measurement.side_spans import SideSpan


@dataclass(frozen=True, slots=True, eq=False)
class Square:
    """A square, a frame, a tag or a rectangle that was found: a `DetectedTarget`."""

    outline: SquareOutline

    @property
    def kind(self) -> str:
        """Return ``"square"``, ``"frame"``, ``"tag"`` or ``"rectangle"``."""
        if self.outline.aspect != 1.0:
            return "rectangle"
        if self.outline.tag is not None:
            return "tag"
        return "square" if self.outline.inner is None else "frame"

    @property
    def quad(self) -> FloatArray:
        """Corners of the outer outline, shape (4, 2), pixels."""
        return self.outline.outer.corners

    def spans(self, first: int) -> list[SideSpan]:
        """Return four spans for each outline, in order, and for the one beside it."""
        spans: list[SideSpan] = []
        for outline in self._outlines():
            spans += self._outline_spans(outline, first + len(spans))
        if (adjacent := self.outline.adjacent) is not None:
            spans += self._outline_spans(adjacent, first + len(spans))
            spans = [replace(span, far_edge=first + (i + 4) % 8) for i, span in enumerate(spans)]
        return spans

    def figures(self, measured: Sequence[SideSamples | str], plane: int) -> list[PlaneEdges]:
        """Return one figure for each outline, all four sides of which are edges."""
        sides = iter(measured)
        figures = []
        for outline in self._outlines():
            outline_sides = [next(sides) for _ in range(4)]
            samples = [side for side in outline_sides if not isinstance(side, str)]
            # An outline with a side that is not an edge is not a square; without its outer outline,
            # a frame's inner one is a square of its own.
            if len(samples) == 4:
                with suppress(TrisquareError, ValueError):  # four lines that bound no figure
                    figures.append(self._edges(outline, samples, plane))
        return figures

    def _edges(self, outline: Outline, sides: list[SideSamples], plane: int) -> PlaneEdges:
        points = tuple(side.points for side in sides)
        drift = tuple(side.drift for side in sides if side.drift is not None)
        freedom = "size" if self.kind == "frame" else "auto"
        aspect = self.outline.aspect
        if aspect is None:
            aspect, freedom = 1.0, "aspect"
        return unchecked_edges(
            lines=rectangle_lines(points, aspect),
            points=points,
            std=tuple(side.std for side in sides),
            polarity=None if self.outline.adjacent else 1 if outline.dark_inside else -1,
            plane=plane,
            kind=self.kind,
            freedom=freedom,
            drift=drift or None,
            border=self._border,
        )

    def _outline_spans(self, outline: Outline, first: int) -> list[SideSpan]:
        border = self._border
        polarity = -1.0 if outline.dark_inside else 1.0
        margins = side_margins(outline.corners, math.inf if border is None else border, math.inf)
        return [
            SideSpan(
                np.ascontiguousarray(side),
                polarity,
                (first + (i + 3) % 4, first + (i + 1) % 4),
                margins[i],
                is_beside_others=self.outline.is_beside_others,
            )
            for i, side in enumerate(outline.sides)
        ]

    @property
    def _border(self) -> float | None:
        """Width of a tag's black border over its side."""
        tag = self.outline.tag
        return None if tag is None else BORDER / (dictionary(tag.dictionary).side + 2 * BORDER)

    def _outlines(self) -> list[Outline]:
        outer, inner = self.outline.outer, self.outline.inner
        return [outer] if inner is None else [outer, inner]
