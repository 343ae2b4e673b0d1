"""`trisquare calibrate`: a camera from its photographs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from trisquare._support.json_members import dump_members
from trisquare._support.suggestions import unknown
from trisquare._support.writing import PathLike
from trisquare.analysis.diagnosis import diagnose
from trisquare.calibration.calibrate import calibrate_photographs
from trisquare.calibration.missed_squares import missed_squares
from trisquare.camera.lens_models import MODELS
from trisquare.camera.settings import AUTO, METHODS
from trisquare.cli.camera_file import camera_content, camera_format
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
from trisquare.images.pixels import TONE_CURVES, checked_tone
from trisquare.images.video import is_video
from trisquare.report import check_extra, report_page
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import SEVERITIES
from trisquare.results.rejected import Rejected

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
    failing = _failing_severities(fail_on)
    photos = photographs_named(photos, with_videos=frames is not None)
    most = _most_pictures(photos, frames)
    files = _Files(output, report, numbered_paths(overlay, most), numbered_paths(debug_image, most))
    # Only a layout's file can have the same name as an output.
    files.check([*photos, outline, initial, None if board is None else Path(board)])
    if board is not None:
        targets = _checked_layout(board, targets)  # one argument in Python
    known = None if initial is None else camera_alone(initial)
    limits = PictureLimits.stated(
        amount(max_pixels, "--max-pixels"), amount(max_bytes, "--max-bytes")
    )
    with progress_bar("choosing frames", quiet) as progress, reading():
        sources = with_frames(with_content_of_input(photos, limits), frames, limits, progress)
    photographs = Photographs(sources, keep=bool(overlay or debug_image or report), limits=limits)
    with (
        drawn_on_failure(photographs, files.debug_images),
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
    outputs = files.write(calibration, rejected_shapes, photographs, context)
    parts = calibration_report(calibration, missed_squares(calibration, rejected_shapes))
    members = calibration.members()
    if with_diagnosis:
        diagnosis = diagnose(calibration)
        parts += str(diagnosis).split("\n")
        members["diagnosis"] = diagnosis.members()
    parts += [_written_line(path, output) for path in outputs.written]
    warnings = warning_lines(calibration, verbose=verbose)
    answer(json, quiet, dump_members(members).rstrip(), parts, warnings)
    outputs.raise_first_failure()
    if any(warning.severity in failing for warning in calibration.warnings):
        raise typer.Exit(NOT_ALL_PASSED_EXIT)


@dataclass(frozen=True)
class _Files:
    """The output files that are asked for."""

    result: Path | None
    report: Path | None
    overlays: list[Path]
    debug_images: list[Path]

    def check(self, inputs: Iterable[Path | None]) -> None:
        """Refuse files that cannot be written, before anything is computed."""
        check_outputs(inputs, [*self.overlays, *self.debug_images], [self.result, self.report])
        if self.result is not None:
            format_of_name(self.result.name, OTHER_ENDING)
        if self.report is not None:
            if self.report.suffix.lower() not in REPORT_ENDINGS:
                raise ValueError(f"{self.report}: a report is a page: let its name end in .html")
            check_extra()

    def write(
        self,
        calibration: Calibration,
        rejected_shapes: Iterable[Rejected],
        photographs: Photographs,
        context: typer.Context,
    ) -> Outputs:
        """Write all of them; the failure of one does not prevent the others."""
        outputs = Outputs()
        result, report = self.result, self.report
        if result is not None:
            outputs.write(lambda: {result: _result_content(calibration, result)})
        found = calibration.planes, [*calibration.rejected, *rejected_shapes]
        outputs.write(lambda: drawn(draw_detections, photographs, self.debug_images, *found))
        outputs.write(lambda: drawn(draw_overlay, photographs, self.overlays, calibration))
        if report is not None:
            command = command_line(context)
            outputs.write(lambda: {report: report_page(calibration, photographs, command=command)})
        return outputs


def _failing_severities(fail_on: str | None) -> Sequence[str]:
    """Return the severities that make the command fail: the given one and the higher ones."""
    if fail_on is None:
        return ()
    if fail_on not in SEVERITIES:
        raise unknown("--fail-on", fail_on, SEVERITIES)
    return SEVERITIES[: SEVERITIES.index(fail_on) + 1]


def _most_pictures(photos: Sequence[Path], frames: int | None) -> int:
    """Return the maximum number of pictures, with the frames that are chosen from videos."""
    return len(photos) + sum(map(is_video, photos)) * max(0, (frames or 1) - 1)


def _checked_layout(board: str, targets: str) -> str:
    """Return the layout of `--board`, which excludes `--targets`."""
    if targets != "auto":
        raise ValueError("--board and --targets both name the targets: give one of them")
    with reading():
        parse_layout(board)
    return board


def _result_content(calibration: Calibration, path: Path) -> bytes:
    """Return the content of the result's file, in a format other than JSON the camera alone."""
    if camera_format(path) is OWN_FORMAT:
        return calibration.to_json().encode()
    return camera_content(calibration.camera, path)


def _written_line(path: PathLike, result: Path | None) -> str:
    """Return a line on a written file, with a note if it is the result and the camera alone."""
    note = ""
    if result is not None and path == result and camera_format(result) is not OWN_FORMAT:
        note = f" ({camera_format(result).name}: the camera alone)"
    return f"wrote {path}{note}"
