"""What a search hands to the measurement of edges, and what it gets back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

from trisquare._support.arrays import FloatArray
from trisquare.edges import PlaneEdges

Edge: TypeAlias = tuple[FloatArray, float, tuple[int | None, int | None]]
"""A coarse path (N, 2) in pixels, where it gets lighter (+1 toward the right-hand normal, else
-1), and the spans that bound it at its start and end, by their numbers."""

Confined: TypeAlias = tuple[FloatArray, float, tuple[int | None, int | None], tuple[float, float]]
"""The same with the margins on its left and on its right, pixels (or infinite), beyond which
something else begins."""

GridLine: TypeAlias = tuple[FloatArray, float, tuple[None, None], Sequence[tuple[int | None, int]]]
"""The crossings of a chessboard's grid line (N, 2) in pixels, where it gets lighter after the
first, and for each the span that crosses there and its place among all crossings of that line.
After every crossing light and dark are exchanged; between two that are no neighbours nothing is
measured."""

MarkedLine: TypeAlias = tuple[
    FloatArray, float, tuple[None, None], Sequence[tuple[int | None, int]], Sequence[float]
]
"""The same with, for the stretch after each crossing, how far from the edges of the light cell
beside it a marker begins, over the cell's side; 0 where there is none."""

Span: TypeAlias = Edge | Confined | GridLine | MarkedLine

Samples: TypeAlias = tuple[FloatArray, FloatArray, FloatArray | None]
"""Points (N, 2), standard deviations (N,) and drift (N, 2) of one span, in pixels."""


class DetectedTarget(Protocol):
    """A flat target that a search found in one picture, before its edges are measured."""

    @property
    def kind(self) -> str:
        """What it is called in results."""

    @property
    def quad(self) -> FloatArray:
        """Four points of the picture that enclose it, shape (4, 2), pixels."""

    def spans(self, first: int) -> list[Span]:
        """Spans to measure, the first of which gets the number `first`."""

    def figures(self, measured: Sequence[Samples | str], plane: int) -> list[PlaneEdges]:
        """Edges from its measured spans, or why each gave none; empty if they are too few."""
