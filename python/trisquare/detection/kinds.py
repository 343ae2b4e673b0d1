"""Kinds of targets to search for in a picture."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trisquare._support.suggestions import unknown
from trisquare.detection.grey import RANGE_PERCENTILES, RELIABLE_SIDE, working_scale
from trisquare.detection.squares.rectangle_shape import NAMED_ASPECTS, RectangleShape
from trisquare.detection.tags.families import (
    APRILTAG,
    ARUCO,
    DICTIONARIES,
    TagSearch,
    dictionary_name,
)
from trisquare.results.rejected import Rejected

if TYPE_CHECKING:
    from trisquare.detection.sheets.layout import Layout

_BOARD = "name its inner corners, chessboard:9x6, or leave targets out: boards are found by default"

LAYOUT_ADVICE = {
    "chessboard": _BOARD,
    "checkerboard": _BOARD,
    "charuco": "name its layout, charuco:10x10:0.75 (squares across and down, marker over square)",
}
"""Advice in the messages for boards that are named without their layout."""

SMALLEST_BOARD = 3
"""Minimum number of inner corners of a chessboard per direction."""

SQUARE_WIDTH, TAG_WIDTH = 30, 40
"""Recommended minimum widths of a square and a tag, pixels, in a picture searched at full size."""

CHOICES = (
    "auto, squares, tags, aruco, apriltag, tags:6X6_250, chessboard:9x6, rectangles (a4, letter, "
    "card, 16:9, rectangle:1.5), or a board of known layout, such as charuco:10x10:0.75, "
    "aruco:5x7:0.2, apriltag:6x6:0.3, aprilgrid:6x6:0.3 or layout.json"
)

SHEETS = ("charuco:", "aruco:", "apriltag:", "aprilgrid:")
"""Prefixes of the names of layouts."""

TAG_SEARCHES = {
    "auto": TagSearch(DICTIONARIES),
    "squares": None,
    "tags": TagSearch(DICTIONARIES),
    "aruco": TagSearch(ARUCO),
    "apriltag": TagSearch(APRILTAG),
}


@dataclass(frozen=True, slots=True)
class TargetKinds:
    """Kinds of targets to search for: squares, tags, chessboards, sheets or rectangles.

    Attributes
    ----------
    board : tuple of int or None
        Inner corners across and down of the chessboards to search for.
    layout : Layout or None
        The sheets to search for.
    tags : TagSearch or None
        Tags to search for, each on its own.
    squares : bool
        Whether to search for squares without a code.
    lattices : bool
        Whether to search for chessboards of any size.
    grids : bool
        Whether to search for AprilGrids of any size.
    rectangles : RectangleShape or None
        Rectangles to search for.
    """

    board: tuple[int, int] | None = None
    layout: Layout | None = None
    tags: TagSearch | None = None
    squares: bool = False
    lattices: bool = False
    grids: bool = False
    rectangles: RectangleShape | None = None

    @property
    def has_rectangles_of_known_shape(self) -> bool:
        """Whether rectangles of a known aspect are searched for; those found may differ."""
        return self.rectangles is not None and self.rectangles.aspect is not None

    @classmethod
    def parse(cls, text: str) -> TargetKinds:
        """Read a name of `CHOICES`.

        Raises
        ------
        TypeError, ValueError
            For anything else.
        """
        if not isinstance(text, str):
            raise TypeError(f"targets must be a string, not {type(text).__name__}")
        if text in TAG_SEARCHES:
            return cls(
                tags=TAG_SEARCHES[text],
                squares=text in ("auto", "squares"),
                lattices=text == "auto",
                grids=text in ("auto", "tags", "apriltag"),
            )
        if shape := RectangleShape.parse(text):
            return cls(rectangles=shape)
        if text.startswith("tags:"):
            name = dictionary_name(text.removeprefix("tags:"))
            return cls(tags=TagSearch((name,), stated=True))
        if text.startswith(SHEETS) or text.lower().endswith(".json"):
            from trisquare.detection.sheets.layout import parse_layout

            return cls(layout=parse_layout(text))
        match = re.fullmatch(r"chessboard:(\d{1,3})x(\d{1,3})", text)
        if match is None:
            if text in LAYOUT_ADVICE:
                raise ValueError(
                    f"{text!r} is not a complete name of targets: {LAYOUT_ADVICE[text]}"
                )
            raise unknown("targets", text, (*TAG_SEARCHES, *NAMED_ASPECTS, "rectangle"), CHOICES)
        cols, rows = int(match[1]), int(match[2])
        if min(cols, rows) < SMALLEST_BOARD:
            raise ValueError(f"a chessboard needs 3 x 3 inner corners or more, not {cols} x {rows}")
        return cls(board=(cols, rows))


def nothing_found(
    targets: TargetKinds,
    size: tuple[int, int],
    rejected: Sequence[Rejected] = (),
    *,
    lack: str = "",
) -> str:
    """Describe what was searched for in vain, and why each near candidate was rejected.

    `size` is that of the picture, on which the minimum size of a target depends; `lack` describes
    the lack of contrast of a picture that hardly has any.
    """
    reasons = dict.fromkeys(
        f"a {candidate.kind} was not used: {candidate.reason}" for candidate in rejected
    )
    missing = _missing(targets, size)
    return "; ".join([f"{lack}: {missing}" if lack else missing, *reasons])


def _missing(targets: TargetKinds, size: tuple[int, int]) -> str:
    wide = f"at least {_least_width(SQUARE_WIDTH, size)} pixels wide"
    tag = _least_width(TAG_WIDTH, size)
    large = f"in a picture of {size[0]} x {size[1]}{_lonely_squares(size)}"
    if targets.board is not None:
        cols, rows = targets.board
        return f"no chessboard of {cols} x {rows} inner corners found"
    if targets.layout is not None:
        return f"no sheet of {targets.layout.text} found"
    if targets.rectangles is not None:
        return (
            "no rectangle of that shape found: it must be wholly visible, stand out from its "
            f"ground along all its sides, and be {wide} in a picture of {size[0]} x {size[1]}"
        )
    squares = (
        "squares must be dark on a light ground (or the reverse; outlines at least 4 pixels "
        f"thick), wholly visible, apart from each other, and {wide}"
    )
    if targets.lattices:
        return f"no square, chessboard or tag found: {squares}, tags {tag}, {large}"
    if not targets.squares:
        return (
            "no tag found: its whole black border must be visible on a white margin, and "
            f"be at least {tag} pixels wide in a picture of {size[0]} x {size[1]}"
        )
    return (
        f"no square found: {squares} {large}; boards and tags were not searched for, which "
        "targets auto does"
    )


def _least_width(usual: int, size: tuple[int, int]) -> int:
    return max(usual, RELIABLE_SIDE * working_scale(size))


def _lonely_squares(size: tuple[int, int]) -> str:
    """Give the minimum size of the only dark squares: thresholds span nearly all grey levels."""
    share = RANGE_PERCENTILES[0] / 100.0
    width = 10 * math.ceil(math.sqrt(share * size[0] * size[1] / 3.0) / 10.0)
    if width <= _least_width(SQUARE_WIDTH, size):
        return ""
    return (
        f"; if nothing else in it is as dark (or as light), they must cover {100.0 * share:g} % "
        f"of it, as three squares {width} pixels wide do"
    )
