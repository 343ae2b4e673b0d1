"""`trisquare calibrate`: a camera from its photographs."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import typer

from trisquare._support.json_members import dump_members
from trisquare._support.suggestions import unknown
from trisquare._support.writing import write_atomically
from trisquare.analysis.diagnosis import diagnose
from trisquare.calibration.calibrate import calibrate_photographs
from trisquare.calibration.missed_squares import missed_squares
from trisquare.camera.lens_models import MODELS
from trisquare.camera.settings import AUTO, METHODS
from trisquare.cli.console import answer, progress_bar
from trisquare.cli.framework import NOT_ALL_PASSED_EXIT, command_line, reading
from trisquare.cli.input_files import camera_alone, photographs_named, with_content_of_input
from trisquare.cli.options import (
    FIX,
    FRAMES,
    FREE,
    INITIAL,
    JSON,
    MAX_BYTES,
    MAX_PIXELS,
    ORTHOGONAL,
    PARALLEL,
    PHOTOS_OR_INPUT,
    QUIET,
    amount,
    flag,
    listed_names,
    option,
    parse_pairs,
)
from trisquare.cli.outputs import Outputs
from trisquare.cli.pictures_drawn import check_outputs, drawn, drawn_on_failure, numbered_paths
from trisquare.cli.tables import calibration_report, warning_lines
from trisquare.detection.kinds import TAG_SEARCHES
from trisquare.detection.sheets.layout import parse_layout
from trisquare.drawing.detections import draw_detections
from trisquare.drawing.overlay import draw_overlay
from trisquare.formats.native_json import FORMAT as OWN_FORMAT
from trisquare.formats.registry import ENDINGS, format_of_name
from trisquare.images.frame_choice import with_frames
from trisquare.images.limits import PictureLimits
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import TONE_CURVES, Image, checked_tone
from trisquare.images.video import is_video
from trisquare.report import check_extra, report_page
from trisquare.results.calibration_warning import SEVERITIES

EXAMPLES = (
    "trisquare calibrate photo.jpg",
    "trisquare calibrate photo.jpg -o camera.json --overlay overlay.png --diagnose",
    "trisquare calibrate one.jpg two.jpg three.jpg --model auto --json",
    "trisquare calibrate board.png --targets chessboard:9x6 --fix aspect,principal_point",
    "trisquare calibrate photo.jpg --initial camera.json --fix focal,principal_point",
    "trisquare calibrate clip.mp4 --frames 10 -o camera.json",
)


REPORT_ENDINGS = ("", ".html", ".htm", ".xhtml")

OTHER_ENDING = f"let it end with .json for all of the result, or with one of {', '.join(ENDINGS)}"


def calibrate_command(
    context: typer.Context,
    photos: list[Path] = PHOTOS_OR_INPUT,
    output: Path | None = option(
        None,
        "FILE",
        "Write the result to this file: .json for the whole result; any other extension that "
        "convert knows, such as .yaml, for the camera alone in that format.",
        "--output",
        "-o",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
    overlay: Path | None = option(
        None,
        "FILE",
        "Draw the measured edges and their residuals over the photograph. With several "
        "photographs, FILE.png becomes FILE-1.png, FILE-2.png, ...",
    ),
    debug_image: Path | None = option(
        None,
        "FILE",
        "Draw the targets that were found and, in another colour, the rejected shapes with the "
        "reasons; also if the calibration fails. Several photographs as for --overlay.",
    ),
    report: Path | None = option(
        None,
        "FILE",
        "Write a report as one HTML page, with pictures and plots, that opens offline. Needs pip "
        "install 'trisquare[report]'.",
    ),
    model: str = option(
        "radial2",
        "MODEL",
        "Lens model: none, radial1, radial2, radial3, brown, equidistant, fisheye1, fisheye2, "
        "fisheye, rational, brown_prism, thin_prism, or auto (chosen by evidence).",
        offer=(*MODELS, AUTO),
    ),
    method: str = option(
        "ml",
        "METHOD",
        "Method: ml (maximum likelihood), or linear (the paper's three linear steps alone).",
        offer=METHODS,
    ),
    fix: list[str] | None = FIX,
    initial: Path | None = INITIAL,
    free: list[str] | None = FREE,
    orthogonal: list[str] | None = ORTHOGONAL,
    parallel: list[str] | None = PARALLEL,
    tone: str | None = option(
        None,
        "TONE",
        "Tone curve: auto (estimated), srgb, linear or a gamma. By default auto for 8- and 16-bit "
        "pictures.",
        offer=TONE_CURVES,
    ),
    targets: str = option(
        "auto",
        "TARGETS",
        "Targets to search for: auto, squares, tags, aruco, apriltag, chessboard:9x6 (inner "
        "corners of a checkerboard), or sheets of paper and other rectangles: a4, letter, card, "
        "16:9, rectangle:1.5, rectangle (any); or a layout as for --board.",
        offer=TAG_SEARCHES,
    ),
    board: str | None = option(
        None,
        "LAYOUT",
        "Sheets of markers of a known layout: charuco:10x10:0.75 (squares across and down, marker "
        "over square), aruco:5x7:0.2, apriltag:6x6:0.3 or aprilgrid:6x6:0.3 (gap over marker), "
        "or FILE.json.",
    ),
    outline: Path | None = option(
        None,
        "FILE",
        "Measure the squares outlined in this file, and search for no others: trisquare's JSON or "
        "labelme's, in pixels of the picture as stored, accurate to 5 px.",
    ),
    frames: int | None = FRAMES,
    lines: bool = flag(
        "Use the scene's own straight edges as well, where they are consistent with the squares.",
        "--lines",
    ),
    side: str | None = option(
        None,
        "LENGTH",
        "Length of the squares' sides (on a board: of a cell; of a4, 16:9 and the like: the "
        "shorter one), such as 84mm, for metric poses.",
    ),
    jobs: int | None = option(
        None,
        "N",
        "Read and measure several photographs in N threads; by default as many as there are cores.",
        "--jobs",
        "-j",
    ),
    max_pixels: str | None = MAX_PIXELS,
    max_bytes: str | None = MAX_BYTES,
    with_diagnosis: bool = flag(
        "Show what limits each parameter, and what would improve it; with --json as its member "
        "diagnosis.",
        "--diagnose",
    ),
    fail_on: str | None = option(
        None,
        "SEVERITY",
        "Exit with code 6 if a warning has this severity (high, medium or low) or a higher one; "
        "the result is printed and written all the same.",
        offer=SEVERITIES,
    ),
    verbose: bool = flag("Show all warnings, not only the most severe.", "--verbose", "-v"),
) -> None:
    """Calibrate a camera from its photographs."""
    if with_diagnosis and quiet:
        raise ValueError("--diagnose prints, and --quiet does not: give one of them")
    if fail_on is not None and fail_on not in SEVERITIES:
        raise unknown("--fail-on", fail_on, SEVERITIES)
    photos = photographs_named(photos, with_videos=frames is not None, with_input=True)
    clips = 0 if frames is None else sum(map(is_video, photos))
    most_pictures = len(photos) + clips * max(0, (frames or 0) - 1)
    overlay_paths = numbered_paths(overlay, most_pictures)
    debug_images = numbered_paths(debug_image, most_pictures)
    # Only a layout's file can have the same name as an output.
    inputs = [*photos, outline, initial, None if board is None else Path(board)]
    check_outputs(inputs, [*overlay_paths, *debug_images], [output, report])
    written_as = None if output is None else format_of_name(output.name, OTHER_ENDING)
    if report is not None:
        if report.suffix.lower() not in REPORT_ENDINGS:
            raise ValueError(f"{report}: a report is a page: let its name end in .html")
        check_extra()
    if board is not None:
        if targets != "auto":
            raise ValueError("--board and --targets both name the targets: give one of them")
        with reading():
            parse_layout(board)
        targets = board  # one argument in Python
    known = None if initial is None else camera_alone(initial)
    limits = PictureLimits.stated(
        amount(max_pixels, "--max-pixels"), amount(max_bytes, "--max-bytes")
    )
    with progress_bar("choosing frames", quiet) as progress, reading():
        sources = with_frames(with_content_of_input(photos, limits), frames, limits, progress)
    overlay_paths, debug_images = overlay_paths[: len(sources)], debug_images[: len(sources)]
    photographs = Photographs(sources, keep=bool(overlay or debug_image or report), limits=limits)
    with (
        drawn_on_failure(photographs, debug_images),
        progress_bar("measuring", quiet, then="fitting") as progress,
        reading(),
    ):
        calibration, rejected_shapes = calibrate_photographs(
            photographs,
            method=method,
            model=model,
            fix=listed_names(fix),
            free=listed_names(free),
            initial=known,
            orthogonal=parse_pairs(orthogonal),
            parallel=parse_pairs(parallel),
            tone=checked_tone(tone),
            targets=targets,
            outlines=outline,
            lines=lines,
            side=side,
            threads=jobs,
            progress=progress,
            explain=not (json or quiet),
            explain_all=debug_image is not None,
        )
    rejected = [*calibration.rejected, *rejected_shapes]
    outputs = Outputs()
    if output is not None:
        outputs.attempt([output], lambda: calibration.save(output))

    def write_drawn(paths: list[Path], draw: Callable[..., Image], *what: Any) -> None:
        outputs.attempt(paths, lambda: write_atomically(drawn(draw, photographs, paths, *what)))

    write_drawn(debug_images, draw_detections, calibration.planes, rejected)
    write_drawn(overlay_paths, draw_overlay, calibration)
    if report is not None:
        page = partial(report_page, calibration, photographs, command=command_line(context))
        outputs.attempt([report], lambda: write_atomically({report: page()}))
    parts = calibration_report(calibration, missed_squares(calibration, rejected_shapes))
    members = calibration.members()
    if with_diagnosis:
        diagnosis = diagnose(calibration)
        parts += str(diagnosis).split("\n")
        members["diagnosis"] = diagnosis.members()
    what = ""
    if written_as is not None and written_as is not OWN_FORMAT:
        what = f" ({written_as.name}: the camera alone)"
    for path in outputs.written:
        parts.append(f"wrote {os.fspath(path)}{what if path == output else ''}")
    warnings = warning_lines(calibration, verbose=verbose)
    answer(json, quiet, dump_members(members).rstrip(), parts, warnings)
    outputs.raise_first_failure()
    failing = () if fail_on is None else SEVERITIES[: SEVERITIES.index(fail_on) + 1]
    if any(warning.severity in failing for warning in calibration.warnings):
        raise typer.Exit(NOT_ALL_PASSED_EXIT)
