"""Input and output of the measurement of edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from trisquare._core import SideSamples
from trisquare._support.arrays import FloatArray
from trisquare.edges import PlaneEdges


@dataclass(frozen=True, slots=True, eq=False)
class SideSpan:
    """A stretch of edge that is known coarsely, to be measured by the core.

    Attributes
    ----------
    path : ndarray, shape (N, 2)
        Points along it, pixels; of a chessboard's grid line, its crossings.
    polarity : float
        +1 if it gets lighter toward the right-hand normal, else -1; for a grid line, after its
        first crossing: light and dark are exchanged at each crossing.
    bounds : (int or None, int or None)
        The spans that it meets at its start and its end, by their numbers.
    margins : (float, float)
        Pixels to its left and to its right beyond which something else begins.
    crossings : sequence of (int or None, int)
        For a grid line, for each crossing, the span that crosses there, and its place among all
        crossings of the line; nothing is measured between two that are not neighbours.
    rims : sequence of float
        For a grid line with markers beside it, for the stretch after each crossing, the distance of
        the marker from the edges of its cell, over the cell's side; 0 without a marker.
    tags : sequence of sequence of sequence of bool
        For a grid line between tags, for the stretch after each crossing, which cells of the tag
        beside it are light, in rows from the stretch on; empty where there is no tag.
    tag_border : float
        Width of the tags' border over their side.
    is_beside_others : bool
        Whether other things lie beside the edge, so that the light there changes along it.
    far_edge : int or None
        The span at which the light changes again, if this is an edge of a thin bar.
    """

    path: FloatArray
    polarity: float
    bounds: tuple[int | None, int | None] = (None, None)
    margins: tuple[float, float] = (math.inf, math.inf)
    crossings: Sequence[tuple[int | None, int]] = ()
    rims: Sequence[float] = ()
    tags: Sequence[Sequence[Sequence[bool]]] = ()
    tag_border: float = 0.0
    is_beside_others: bool = False
    far_edge: int | None = None


class DetectedTarget(Protocol):
    """A flat target that a search found in one picture, before its edges are measured."""

    @property
    def kind(self) -> str:
        """Name of the kind in results."""

    @property
    def quad(self) -> FloatArray:
        """Four points of the picture that enclose it, shape (4, 2), pixels."""

    def spans(self, first: int) -> list[SideSpan]:
        """Return the spans to measure, the first of which gets the number `first`."""

    def figures(self, measured: Sequence[SideSamples | str], plane: int) -> list[PlaneEdges]:
        """Return edges from its measured spans, each given as samples or as the reason for none.

        Empty if too few have samples.
        """
