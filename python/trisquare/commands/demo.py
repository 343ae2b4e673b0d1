"""`trisquare demo`: the bundled photograph, and the truth about it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from trisquare.demo import run_demo
from trisquare.tables import comparison_report


def demo_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where to write the results.")
    ] = Path("demo-output"),
) -> None:
    """Calibrate the bundled photograph and compare with the camera that it was made with."""
    demo = run_demo(output)
    report = comparison_report(demo.calibration, demo.truth, demo.written)
    Console().print(report, soft_wrap=True)
