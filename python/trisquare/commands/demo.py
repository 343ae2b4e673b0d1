"""`trisquare demo`: the bundled photograph, and the truth about it."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from trisquare.camera import camera_members
from trisquare.commands.printing import JsonOption, QuietOption, check_printing
from trisquare.commands.progress import progress_bar
from trisquare.demo import Demo, run_demo
from trisquare.tables import comparison_report

DEMO_FORMAT = "trisquare-demo-result/1"

EXAMPLES = ("trisquare demo", "trisquare demo -o results --json")


def demo_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where to write the results.")
    ] = Path("demo-output"),
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Calibrate the bundled photograph and compare with the camera that it was made with."""
    check_printing(json, quiet)
    with progress_bar("calibrating", quiet):
        demo = run_demo(output)
    if json:
        print(json_text.dumps(_members(demo), indent=2, allow_nan=False))
    elif not quiet:
        report = comparison_report(demo.calibration, demo.truth, demo.written)
        Console().print(report, soft_wrap=True)


def _members(demo: Demo) -> dict[str, Any]:
    return {
        "format": DEMO_FORMAT,
        "image_size": list(demo.truth.image_size),
        "camera": camera_members(demo.truth),
        "calibration": json_text.loads(demo.calibration.to_json()),
        "written": [str(path) for path in demo.written],
    }
