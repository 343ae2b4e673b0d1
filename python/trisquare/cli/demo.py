"""`trisquare demo`: the bundled photograph, and the truth about it."""

from __future__ import annotations

import json as json_text
import shlex
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

from trisquare._support.json_members import JsonFields
from trisquare._support.writing import PathLike, write_atomically, writing
from trisquare.calibration.calibrate import calibrate
from trisquare.camera.members import camera_from_members, camera_members
from trisquare.cli.console import answer, progress_bar
from trisquare.cli.options import JSON, QUIET, option
from trisquare.cli.tables import comparison_report, warning_lines
from trisquare.drawing.overlay import draw_overlay
from trisquare.images.drawn_mark import encode_drawn
from trisquare.images.photographs import Photographs
from trisquare.report import check_extra, report_page
from trisquare.results.plane import Plane

DEMO_FORMAT = "trisquare-demo-result/1"
TRUTH_FORMAT = "trisquare-demo/1"

SIDE = 84.0
"""Side of the frames of the printed corner on A4, millimetres."""

EXAMPLES = ("trisquare demo", "trisquare demo -o results --json")


def demo_command(
    output: Path = option(
        Path("demo-output"), "FOLDER", "Where to write the results.", "--output", "-o"
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Calibrate the bundled photograph and compare with the camera that it was made with."""
    with writing(output):
        output.mkdir(parents=True, exist_ok=True)
    data = resources.files("trisquare") / "data"
    photo, camera, overlay, report = (
        output / name for name in ("photo.png", "camera.json", "overlay.png", "report.html")
    )
    write_atomically({photo: (data / "demo.png").read_bytes()})
    photographs = Photographs([photo], keep=True)
    (photograph,) = photographs
    with progress_bar("calibrating", quiet):
        calibration = calibrate(photograph.pixels)
    files: dict[PathLike, bytes] = {
        camera: calibration.to_json().encode(),
        overlay: encode_drawn(draw_overlay(photograph.pixels, calibration), overlay),
    }
    notes = []
    try:
        check_extra()
    except ImportError as error:
        notes.append(f"no report: {error}")
    else:
        repeated = f"trisquare calibrate {photo.name} --report {report.name}"
        files[report] = report_page(calibration, photographs, command=repeated)
    write_atomically(files)
    fields = JsonFields.parse((data / "demo.json").read_text("utf-8"), TRUTH_FORMAT)
    truth = camera_from_members(fields.object("camera"), fields.integers("image_size"))
    members = {
        "format": DEMO_FORMAT,
        "image_size": list(truth.image_size),
        "camera": camera_members(truth),
        "calibration": json_text.loads(calibration.to_json()),
        "written": [str(path) for path in (photo, *files)],
    }
    written = [f"wrote {path}" for path in (photo, *files)]
    next_steps = _next_steps(photo, camera, calibration.planes[0])
    lines = [*comparison_report(calibration, truth), *notes, *written, *next_steps]
    answer(json, quiet, members, lines, warning_lines(calibration))


def _next_steps(photo: Path, camera: Path, frame: Plane) -> Iterator[str]:
    """Yield the next commands for this photograph; the true length of a diagonal is known."""
    first, _, opposite, _ = frame.corners
    points = ["{:.1f},{:.1f}".format(*corner) for corner in (first, opposite)]
    known = [str(photo), "--camera", str(camera)]
    straight = str(photo.with_name("straight.png"))
    yield "next:"
    yield "  " + shlex.join(["trisquare", "undistort", *known, "-o", straight])
    yield "  " + shlex.join(["trisquare", "measure", *known, "--side", f"{SIDE:g}mm", *points])
    yield f"    the diagonal of a frame of {SIDE:g} mm: {2**0.5 * SIDE:.2f} mm is the truth"
    yield "  trisquare calibrate PHOTO -o camera.json --report report.html"
    yield "    the same of a photograph of your own"
