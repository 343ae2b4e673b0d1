"""What to look for in a picture, and finding it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from trisquare import _core
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.pictures import ImageSource, Tone, checked_tone, load_picture, tone_of

SMALLEST_BOARD = 3
"""Inner corners per direction that a chessboard must have."""


@dataclass(frozen=True, slots=True)
class Targets:
    """What to look for: squares, or one chessboard of so many inner corners."""

    board: tuple[int, int] | None

    @classmethod
    def parse(cls, text: str) -> Targets:
        """Read ``"auto"``, ``"squares"`` or ``"chessboard:9x6"``.

        Raises
        ------
        TypeError, ValueError
            For anything else.
        """
        if not isinstance(text, str):
            raise TypeError(f"targets must be a string, not {type(text).__name__}")
        if text in ("auto", "squares"):
            return cls(board=None)
        match = re.fullmatch(r"chessboard:(\d{1,3})x(\d{1,3})", text)
        if match is None:
            raise ValueError(f"unknown targets {text!r}: choose auto, squares, or chessboard:9x6")
        cols, rows = int(match[1]), int(match[2])
        if min(cols, rows) < SMALLEST_BOARD:
            raise ValueError(f"a chessboard needs 3 x 3 inner corners or more, not {cols} x {rows}")
        return cls(board=(cols, rows))


def detect(image: ImageSource, targets: str = "auto", tone: Tone = None) -> list[PlaneEdges]:
    """Find planar targets and measure their edges.

    Parameters
    ----------
    image : path or ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    targets : str
        ``"auto"`` or ``"squares"``: dark squares on a lighter ground or the reverse, solid or
        framed. ``"chessboard:9x6"``: one board of 9 x 6 inner corners.
    tone : {"auto", "srgb", "linear"} or float, optional
        How light was coded into pixel values; a number is a gamma, and "auto" estimates the curve
        from the edges' profiles. By default sRGB for 8-bit pictures and linear for others.

    Returns
    -------
    list of PlaneEdges
        Samples in pixels with a standard deviation each. A frame gives two figures that share
        their `plane`.

    Raises
    ------
    ImageError
        If a file cannot be read whole.
    DetectionError
        If no target is found.
    TypeError, ValueError
        For bad arguments.
    """
    from trisquare.measurement import measure  # OpenCV is loaded where a picture is searched

    wanted = Targets.parse(targets)
    checked = checked_tone(tone)
    picture = load_picture(image)
    found = measure(picture, _core.Picture(picture), wanted, tone_of(picture, checked)).figures
    if not found:
        raise DetectionError(nothing_found(wanted))
    return found


def nothing_found(targets: Targets) -> str:
    """Say what was looked for in vain."""
    if targets.board is None:
        return (
            "no square found: show dark squares on a light ground (or the reverse), whole, apart "
            "from each other, each at least some 30 pixels wide"
        )
    cols, rows = targets.board
    return f"no chessboard of {cols} x {rows} inner corners found"
