"""A target to print: three framed squares, one to a sheet, or three figures folded into a corner.

>>> import trisquare as ts
>>> ts.printed_target("corner", page="A4").save("target.pdf")  # doctest: +SKIP
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal, TypeAlias

from trisquare._core import __version__
from trisquare._support.arrays import Frozen
from trisquare._support.lengths import length_in
from trisquare._support.paths import shown
from trisquare._support.suggestions import unknown
from trisquare._support.writing import check_writable, write_atomically
from trisquare.printing.layout import (
    PAGES,
    PrintedBoard,
    PrintedFrame,
    TargetPage,
    corner_page,
    flat_pages,
)
from trisquare.printing.pdf import pdf_of

__all__ = ["PAGES", "PrintedBoard", "PrintedFrame", "PrintedTarget", "TargetPage", "printed_target"]

TargetKind: TypeAlias = Literal["corner", "boards", "flat", "both"]
KINDS: tuple[TargetKind, ...] = ("corner", "boards", "flat", "both")


@dataclass(frozen=True, slots=True)
class PrintedTarget(Frozen):
    """A target to print.

    Attributes
    ----------
    page : str
        Name of the paper's size.
    pages : tuple of TargetPage
        Layouts of the pages, in millimetres.

    Examples
    --------
    >>> target = ts.printed_target("flat", page="A3")
    >>> target.page, len(target.pages)
    ('A3', 3)
    """

    page: str
    pages: tuple[TargetPage, ...]

    def __repr__(self) -> str:
        sides = ", ".join(
            f"{page.kind} {page.frames[0].side:g} mm x {len(page.frames)}" for page in self.pages
        )
        return f"<PrintedTarget on {self.page}: {sides}>"

    def to_pdf(self) -> bytes:
        """Return the pages as PDF; the same target gives the same bytes.

        Raises
        ------
        ImportError
            If reportlab is not installed: it comes with ``trisquare[target]``.

        Examples
        --------
        >>> ts.printed_target().to_pdf()[:5]
        b'%PDF-'
        """
        return pdf_of(self.pages, f"trisquare target, {self.page}", f"trisquare {__version__}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the PDF, completely or not at all.

        Raises
        ------
        ImportError
            As `to_pdf`.
        OSError
            If it cannot be written there.
        ValueError
            If the file's name does not end with ``.pdf``.

        Examples
        --------
        >>> ts.printed_target().save("target.pdf")
        """
        if not os.fspath(path).lower().endswith(".pdf"):
            raise ValueError(f"{shown(path)}: a target is written as PDF: name a .pdf file")
        check_writable(path)
        write_atomically({path: self.to_pdf()})


def printed_target(
    kind: TargetKind = "both", *, page: str = "A4", side: str | float | None = None
) -> PrintedTarget:
    """Lay out three framed squares, or three chessboards, for printing.

    Parameters
    ----------
    kind : {"corner", "boards", "flat", "both"}
        One sheet that folds and glues into a corner of three frames; the same with three
        chessboards, which give more information and need larger pictures; three sheets with one
        frame each; or the first and the third of these.
    page : {"A4", "A3", "Letter"}
        The paper, upright.
    side : str or float, optional
        Side of each frame or board: a text such as ``"84mm"``, or millimetres; by default the
        largest whole number of millimetres that leaves the light margin: on A4 84 for the corner's
        frames, 91 for its boards, 169 for a flat frame.

    Returns
    -------
    PrintedTarget

    Raises
    ------
    TypeError, ValueError
        If the kind or the page is unknown, the page is too small for the side, or the side is
        too small to be printed well.

    Examples
    --------
    >>> target = ts.printed_target("corner", page="A4")
    >>> target.pages[0].frames[0].side
    84.0
    """
    if kind not in KINDS:
        raise unknown("kind of target", str(kind), KINDS)
    if not isinstance(page, str):
        raise TypeError(f"page must be a name, not {page!r}")
    name = next((known for known in PAGES if known.lower() == page.strip().lower()), None)
    if name is None:
        raise unknown("page", page, PAGES)
    length = length_in("mm", side, "side")
    if kind == "boards":
        return PrintedTarget(name, (corner_page(name, length, PrintedBoard),))
    corner = [] if kind == "flat" else [corner_page(name, length)]
    flat = [] if kind == "corner" else flat_pages(name, length)
    return PrintedTarget(name, (*corner, *flat))
