"""`trisquare calibrate`: a camera from its photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from trisquare._support.writing import write_atomically
from trisquare.analysis.diagnosis import diagnose
from trisquare.calibration.calibrate import calibrate
from trisquare.camera.camera import MODELS
from trisquare.camera.settings import AUTO, METHODS
from trisquare.cli.console import JsonOption, QuietOption, check_printing, progress_bar
from trisquare.cli.framework import command_line, reading
from trisquare.cli.options import FixOption, completing, fixed_names
from trisquare.cli.pictures_drawn import (
    check_outputs,
    debug_pictures,
    drawn_on_failure,
    numbered_paths,
    overlay_of,
)
from trisquare.cli.tables import calibration_report
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.kinds import TAG_SEARCHES, TargetKinds
from trisquare.detection.sheets.layout import parse_layout
from trisquare.images.pixels import TONE_CURVES
from trisquare.report import check_extra, report_page

EXAMPLES = (
    "trisquare calibrate photo.jpg",
    "trisquare calibrate photo.jpg -o camera.json --overlay overlay.png --diagnose",
    "trisquare calibrate one.jpg two.jpg three.jpg --model auto --json",
    "trisquare calibrate board.png --targets chessboard:9x6 --fix aspect",
)


def calibrate_command(
    context: typer.Context,
    photos: Annotated[
        list[Path],
        typer.Argument(metavar="PHOTO", help="One photograph, or several of the same camera."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the result there as JSON."),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    overlay: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw what was measured over the photograph. With several photographs FILE.png "
            "stands for FILE-1.png, FILE-2.png, ...",
        ),
    ] = None,
    debug_image: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw what was found, and in another colour what was not used and why; also when "
            "the calibration fails. Several photographs as for --overlay.",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write all of it as one HTML page, with pictures and plots, that opens offline. "
            "Needs pip install 'trisquare[report]'.",
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            autocompletion=completing((*MODELS, AUTO)),
            help="Distortion: none, radial1, radial2, radial3, brown, or auto: by evidence.",
        ),
    ] = "radial2",
    method: Annotated[
        str,
        typer.Option(
            metavar="METHOD",
            autocompletion=completing(METHODS),
            help="ml, or linear for the paper's three steps alone.",
        ),
    ] = "ml",
    fix: FixOption = None,
    tone: Annotated[
        str | None,
        typer.Option(
            metavar="TONE",
            autocompletion=completing(TONE_CURVES),
            help="Tone curve: auto (estimated), srgb, linear or a gamma. By default srgb for 8-bit "
            "pictures.",
        ),
    ] = None,
    targets: Annotated[
        str,
        typer.Option(
            metavar="TARGETS",
            autocompletion=completing(TAG_SEARCHES),
            help="auto, squares, tags, aruco, apriltag, or chessboard:9x6 (inner corners).",
        ),
    ] = "auto",
    board: Annotated[
        str | None,
        typer.Option(
            metavar="LAYOUT",
            help="Sheets of markers of a known layout: charuco:10x10:0.75 (squares across and "
            "down, marker over square), aruco:5x7:0.2 or apriltag:6x6:0.3 (gap over marker), "
            "or FILE.json.",
        ),
    ] = None,
    outline: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Measure the squares outlined in this file, and search for no others: trisquare's "
            "JSON or labelme's, in pixels of the picture as stored, accurate to 5 px.",
        ),
    ] = None,
    with_diagnosis: Annotated[
        bool,
        typer.Option("--diagnose", help="Say what limits each number, and what would help."),
    ] = False,
) -> None:
    """Calibrate a camera from its photographs."""
    check_printing(json, quiet)
    if with_diagnosis and json:
        raise ValueError("--diagnose adds to the tables, which --json replaces: give one of them")
    overlays = numbered_paths(overlay, len(photos))
    debug_images = numbered_paths(debug_image, len(photos))
    inputs = _inputs(photos, outline, board)
    check_outputs(inputs, output, [*overlays, *debug_images], report)
    if report is not None:
        check_extra()
    if board is not None:
        targets = _targets_of_board(board, targets)
    tone_curve = _tone(tone)
    # Where outlines are drawn by hand, no search passes anything over.
    searched_for = TargetKinds.parse(targets) if outline is None else TargetKinds()
    with (
        drawn_on_failure(photos, debug_images, searched_for),
        progress_bar("calibrating", quiet) as progress,
        reading(),
    ):
        calibration = calibrate(
            photos[0] if len(photos) == 1 else photos,
            method=method,
            model=model,
            fix=fixed_names(fix),
            tone=tone_curve,
            targets=targets,
            outlines=outline,
            progress=progress,
        )
    contents = debug_pictures(
        photos, debug_images, searched_for, calibration.planes, calibration.rejected
    )
    drawings = Annotations.read(outline, photos) if overlays and outline is not None else None
    for index, (photo, path) in enumerate(zip(photos, overlays, strict=False)):
        contents[path] = overlay_of(calibration, photo, index, path, targets, tone_curve, drawings)
    if report is not None:
        contents[report] = report_page(
            calibration,
            photos,
            targets=targets,
            outlines=outline,
            command=command_line(context),
        )
    if output is not None:
        contents[output] = calibration.to_json().encode()
    write_atomically(contents)
    if json:
        print(calibration.to_json(), end="")
    elif not quiet:
        Console().print(calibration_report(calibration), soft_wrap=True)
        if with_diagnosis:
            Console().print(Text(str(diagnose(calibration))), soft_wrap=True)


def _inputs(photos: list[Path], outline: Path | None, board: str | None) -> list[Path]:
    """Return all that is read, and so must not be written to; no board but a file has a name."""
    others = (outline, None if board is None else Path(board))
    return [*photos, *(path for path in others if path is not None)]


def _targets_of_board(board: str, targets: str) -> str:
    """Return the targets that a board is; in Python they are one argument."""
    if targets != "auto":
        raise ValueError("--board and --targets both say what to look for: give one of them")
    with reading():
        parse_layout(board)
    return board


def _tone(text: str | None) -> str | float | None:
    try:
        return text if text is None else float(text)
    except ValueError:
        return text
