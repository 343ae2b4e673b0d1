"""`trisquare target`: three framed squares to print."""

from __future__ import annotations

import json as json_text
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, cast

import typer
from rich.console import Console
from rich.text import Text

from trisquare.cli.console import JsonOption, QuietOption, check_printing
from trisquare.cli.options import completing
from trisquare.printing.layout import PAGES
from trisquare.printing.target import KINDS, PrintedTarget, TargetKind, printed_target

TARGET_FORMAT = "trisquare-target/1"

EXAMPLES = (
    "trisquare target",
    "trisquare target --kind corner --page Letter -o target.pdf",
    "trisquare target --kind flat --side 120 --json",
)


def target_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The PDF to write.")
    ] = Path("target.pdf"),
    page: Annotated[
        str,
        typer.Option(
            metavar="PAGE",
            autocompletion=completing(PAGES),
            help="The paper, upright: A4, A3 or Letter.",
        ),
    ] = "A4",
    kind: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            autocompletion=completing(KINDS),
            help="corner: one sheet that folds and glues into a corner of three planes; flat: "
            "three sheets with a frame each; both: all four.",
        ),
    ] = "both",
    side: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Side of each frame; by default the largest that fits."),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a PDF with three framed squares to print, for one photograph that calibrates.

    JSON tells where everything stands, in mm.
    """
    check_printing(json, quiet)
    # The library says what is wrong with a kind that it does not know.
    target = printed_target(cast(TargetKind, kind), page=page, side=side)
    target.save(output)
    if json:
        members = {"format": TARGET_FORMAT, "output": str(output), **asdict(target)}
        print(json_text.dumps(members, indent=2, allow_nan=False))
    elif not quiet:
        Console().print(Text(_report(target, output)), soft_wrap=True)


def _report(target: PrintedTarget, output: Path) -> str:
    """Say what stands on the pages and how to print them."""
    lines = [f"{output}: {target.page}, to be printed at 100 %"]
    for number, page in enumerate(target.pages, start=1):
        frame = page.frames[0]
        what = "a corner of three frames" if page.kind == "corner" else "one frame"
        hole = frame.inner * frame.side
        lines.append(f"  page {number}: {what}, side {frame.side:g} mm, hole {hole:g} mm")
    return "\n".join(lines)
