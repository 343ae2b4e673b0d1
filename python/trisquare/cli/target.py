"""`trisquare target`: three framed squares, or three chessboards, to print; and to check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import cast

from trisquare._support.lengths import Length
from trisquare.cli.console import answer
from trisquare.cli.options import JSON, QUIET, option
from trisquare.printing.layout import PAGES, PrintedBoard, described
from trisquare.printing.target import KINDS, PrintedTarget, TargetKind, printed_target

TARGET_FORMAT = "trisquare-target/1"

EXAMPLES = (
    "trisquare target",
    "trisquare target --kind corner --page Letter -o target.pdf",
    "trisquare target --kind flat --side 120mm --json",
    "trisquare target --check corner.jpg --ruler 99.5mm",
)

DEFAULT_OUTPUT = Path("target.pdf")


def target_command(
    output: Path | None = option(
        None, "FILE", f"The PDF to write; by default {DEFAULT_OUTPUT}.", "--output", "-o"
    ),
    page: str = option("A4", "PAGE", "The paper, upright: A4, A3 or Letter.", offer=PAGES),
    kind: str = option(
        "both",
        "KIND",
        "corner: one sheet that folds and glues into a corner of three frames; boards: the same "
        "of three chessboards; flat: three sheets with a frame each; both: corner and flat.",
        offer=KINDS,
    ),
    side: str | None = option(
        None,
        "LENGTH",
        "Side of each frame or board, such as 84mm, or a number of mm; by default the largest that "
        "fits.",
    ),
    check: Path | None = option(
        None,
        "PHOTO",
        "Write no PDF, but check in a photograph of the printed sheet whether it is folded at "
        "right angles, flat enough and printed to scale; --kind both is then the folded corner.",
    ),
    ruler: str | None = option(
        None,
        "LENGTH",
        "With --check: the measured length of the sheet's ruler of 100 mm, such as 99.5mm.",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Write a PDF of three frames, or chessboards, to print; or check a printed one.

    The JSON output states where everything is on the sheet, in mm.
    """
    # The library reports an unknown kind.
    known_kind = cast(TargetKind, kind)
    length = None if side is None else Length.parse(side).of_unit("mm")
    if check is not None:
        from trisquare.cli.target_check import check_photograph  # loads OpenCV

        if output is not None:
            raise ValueError("--check writes no PDF, and --output names one: give one of them")
        check_photograph(check, known_kind, page, length, ruler, json=json, quiet=quiet)
        return
    if ruler is not None:
        raise ValueError("--ruler is for a sheet that is checked: give --check PHOTO with it")
    output = DEFAULT_OUTPUT if output is None else output
    target = printed_target(known_kind, page=page, side=length)
    target.save(output)
    members = {"format": TARGET_FORMAT, "output": str(output), **asdict(target)}
    answer(json, quiet, members, _lines(target, output))


def _lines(target: PrintedTarget, output: Path) -> Iterator[str]:
    """Yield lines on the content of the pages, and on printing them."""
    yield f"wrote {output}: {target.page}, to be printed at 100 %"
    for number, page in enumerate(target.pages, start=1):
        figure = page.frames[0]
        named = "chessboards" if isinstance(figure, PrintedBoard) else "frames"
        what = f"a corner of three {named}" if page.kind == "corner" else "one frame"
        yield f"  page {number}: {what}, {described(figure)}"
