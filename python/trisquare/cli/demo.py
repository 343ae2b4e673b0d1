"""`trisquare demo`: the bundled photograph, and the truth about it."""

from __future__ import annotations

import json as json_text
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from trisquare._support.json_members import JsonFields
from trisquare._support.writing import write_atomically, writing
from trisquare.calibration.calibrate import calibrate
from trisquare.camera.camera import Camera
from trisquare.camera.members import camera_from_members, camera_members
from trisquare.cli.console import JsonOption, QuietOption, check_printing, progress_bar
from trisquare.cli.tables import comparison_report
from trisquare.drawing.overlay import draw_overlay
from trisquare.images.encoding import encode_image
from trisquare.images.reading import read_image
from trisquare.results.calibration import Calibration

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


TRUTH_FORMAT = "trisquare-demo/1"


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """What the example gave.

    Parameters
    ----------
    calibration : Calibration
        The estimate from the photograph alone.
    truth : Camera
        The camera that the photograph was rendered with.
    written : tuple of Path
        The camera file and the overlay.
    """

    calibration: Calibration
    truth: Camera
    written: tuple[Path, Path]


def run_demo(folder: Path) -> Demo:
    """Calibrate the bundled photograph and write ``camera.json`` and ``overlay.png``.

    Parameters
    ----------
    folder : Path
        Where to write; made if it is missing.

    Raises
    ------
    OSError
        If the folder cannot be made or written to.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    data = resources.files("trisquare") / "data"
    truth = JsonFields.parse((data / "demo.json").read_text("utf-8"), TRUTH_FORMAT)
    with resources.as_file(data / "demo.png") as photograph:
        image = read_image(photograph)
    calibration = calibrate(image)
    overlay = draw_overlay(image, calibration)
    camera_path, overlay_path = folder / "camera.json", folder / "overlay.png"
    write_atomically(
        {
            camera_path: calibration.to_json().encode(),
            overlay_path: encode_image(overlay, overlay_path),
        }
    )
    return Demo(
        calibration=calibration,
        truth=camera_from_members(truth.object("camera"), truth.integers("image_size")),
        written=(camera_path, overlay_path),
    )
