"""The `trisquare` command.

Exit codes: 0 done; 2 usage, bad argument or unwritable output; 3 nothing found, or not enough of
it; 4 the geometry does not determine the camera, or no convergence; 5 unreadable picture. Every
error is one line on standard error, and no file is written then but what `--debug-image` asks for.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import cv2
import typer
from rich.console import Console
from rich.progress import Progress
from rich.text import Text

from trisquare._core import __version__
from trisquare.calibrate import calibrate
from trisquare.demo import run_demo
from trisquare.detect import detect
from trisquare.drawings import Drawings
from trisquare.errors import (
    ConvergenceError,
    DegenerateGeometryError,
    DetectionError,
    ImageError,
    NotEnoughDataError,
    NotEnoughPlanesError,
    TrisquareError,
)
from trisquare.files import PathLike, check_writable, encode_image, read_image, write_atomically
from trisquare.findings import Place, draw_findings
from trisquare.overlay import draw_overlay
from trisquare.pictures import picture_size
from trisquare.predict_command import predict_command
from trisquare.rejected import Rejected
from trisquare.result import Calibration
from trisquare.sheet_layout import parse_layout
from trisquare.tables import calibration_report, comparison_report
from trisquare.targets import Targets
from trisquare.what_was_found import explain

USAGE_EXIT = 2
INTERRUPTED_EXIT = 130  # what shells report for a process ended by Ctrl-C
EXIT_CODES: Mapping[type[Exception], int] = {
    ValueError: USAGE_EXIT,
    TypeError: USAGE_EXIT,
    OSError: USAGE_EXIT,
    DetectionError: 3,
    NotEnoughPlanesError: 3,
    NotEnoughDataError: 3,
    DegenerateGeometryError: 4,
    ConvergenceError: 4,
    ImageError: 5,
}

# What the command line's parser raises. Newer Typers carry their own copy of Click and older ones
# use Click itself; this finds the class in either.
UsageError: type[Any] = typer.BadParameter.__mro__[1]

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Calibrate a camera from one photograph of three squares.",
)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit; `arguments` defaults to those of the process."""
    _silence_opencv()
    command = typer.main.get_command(app)
    try:
        code = command.main(arguments, prog_name="trisquare", standalone_mode=False)
    except UsageError as error:
        _fail(f"{error.format_message()} (see trisquare --help)", USAGE_EXIT)
    except typer.Abort:
        _fail("interrupted", INTERRUPTED_EXIT)
    except tuple(EXIT_CODES) as error:
        exit_code = next(code for kind, code in EXIT_CODES.items() if isinstance(error, kind))
        _fail(str(error), exit_code)
    sys.exit(code if isinstance(code, int) else 0)


def _silence_opencv() -> None:
    """Keep OpenCV from adding its own lines to the one that says what is wrong."""
    silent = 0
    # OpenCV 5 moved the function.
    set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel
    set_level(silent)


def _fail(message: str, exit_code: int) -> NoReturn:
    print("trisquare: error:", " ".join(message.split()), file=sys.stderr)
    sys.exit(exit_code)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"trisquare {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print version."),
    ] = False,
) -> None:
    pass


@app.command("calibrate")
def calibrate_command(
    photos: Annotated[
        list[Path],
        typer.Argument(metavar="PHOTO", help="One photograph, or several of the same camera."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the result there as JSON."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON instead of tables, and nothing else.")
    ] = False,
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
    model: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            help="Distortion: none, radial1, radial2, radial3, brown, or auto: by evidence.",
        ),
    ] = "radial2",
    method: Annotated[
        str,
        typer.Option(metavar="METHOD", help="ml, or linear for the paper's three steps alone."),
    ] = "ml",
    fix: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHAT",
            help="Hold aspect, principal_point, focal or distortion; repeatable, or with commas.",
        ),
    ] = None,
    tone: Annotated[
        str | None,
        typer.Option(
            metavar="TONE",
            help="Tone curve: auto (estimated), srgb, linear or a gamma. By default srgb for 8-bit "
            "pictures.",
        ),
    ] = None,
    targets: Annotated[
        str,
        typer.Option(
            metavar="TARGETS",
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
            help="Measure the squares that this file outlines, within 5 px of the stored picture, "
            "and look for no others: trisquare's JSON, labelme's, or COCO polygons.",
        ),
    ] = None,
    diagnose: Annotated[
        bool,
        typer.Option("--diagnose", help="Say what limits each number, and what would help."),
    ] = False,
) -> None:
    """Calibrate a camera from its photographs."""
    if diagnose and json:
        raise ValueError("--diagnose adds to the tables, which --json replaces: give one of them")
    overlays = _numbered_paths(overlay, len(photos))
    debug_images = _numbered_paths(debug_image, len(photos))
    _check_outputs(photos, output, [*overlays, *debug_images])
    if board is not None:
        targets = _targets_of_board(board, targets)
    tone_curve = _tone(tone)
    with (
        _drawn_on_failure(photos, debug_images, targets),
        _progress(len(photos)) as progress,
    ):
        calibration = calibrate(
            photos[0] if len(photos) == 1 else photos,
            method=method,
            model=model,
            fix=tuple(name.strip() for names in fix or () for name in names.split(",")),
            tone=tone_curve,
            targets=targets,
            outlines=outline,
            progress=progress,
        )
    contents = _findings(photos, debug_images, targets, calibration.planes, calibration.rejected)
    drawings = Drawings.read(outline, photos) if overlays and outline is not None else None
    for index, (photo, path) in enumerate(zip(photos, overlays, strict=False)):
        contents[path] = _overlay(calibration, photo, index, path, targets, tone_curve, drawings)
    if output is not None:
        contents[output] = calibration.to_json().encode()
    write_atomically(contents)
    if json:
        print(calibration.to_json(), end="")
    else:
        Console().print(calibration_report(calibration), soft_wrap=True)
        if diagnose:
            Console().print(Text(str(calibration.diagnosis)), soft_wrap=True)


app.command("predict")(predict_command)


@app.command("demo")
def demo_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where to write the results.")
    ] = Path("demo-output"),
) -> None:
    """Calibrate the bundled photograph and compare with the camera that it was made with."""
    demo = run_demo(output)
    report = comparison_report(demo.calibration, demo.truth, demo.written)
    Console().print(report, soft_wrap=True)


def _numbered_paths(path: Path | None, photos: int) -> list[Path]:
    """One path for each photograph: FILE.png itself, or FILE-1.png, FILE-2.png, ..."""
    if path is None:
        return []
    if photos == 1:
        return [path]
    return [path.with_name(f"{path.stem}-{number}{path.suffix}") for number in range(1, photos + 1)]


def _check_outputs(photos: Sequence[Path], output: Path | None, drawings: Sequence[Path]) -> None:
    """Refuse outputs that cannot be written before anything is computed."""
    taken = {os.path.realpath(photo) for photo in photos}
    for path in (*drawings, *([] if output is None else [output])):
        check_writable(path)
        if os.path.realpath(path) in taken:
            raise ValueError(f"{path}: would overwrite a photograph or another output")
        taken.add(os.path.realpath(path))
    for path in drawings:
        if not cv2.haveImageWriter(str(path)):
            raise ValueError(f"{path}: no picture format has the extension {path.suffix!r}")


def _targets_of_board(board: str, targets: str) -> str:
    """Return the targets that a board is; in Python they are one argument."""
    if targets != "auto":
        raise ValueError("--board and --targets both say what to look for: give one of them")
    parse_layout(board)
    return board


def _tone(text: str | None) -> str | float | None:
    try:
        return text if text is None else float(text)
    except ValueError:
        return text


def _overlay(
    calibration: Calibration,
    photo: Path,
    index: int,
    path: Path,
    targets: str,
    tone: str | float | None,
    drawings: Drawings | None,
) -> bytes:
    image = read_image(photo)
    edges = []
    # A picture among several in which there is nothing has no edges to draw.
    if any(plane.image == index for plane in calibration.planes):
        drawn = None if drawings is None else drawings.on(index, picture_size(image))
        edges = detect(image, targets=targets, tone=tone, outlines=drawn)
    edges = [replace(figure, image=index) for figure in edges]
    return encode_image(draw_overlay(image, calibration, edges, index=index), path)


@contextmanager
def _drawn_on_failure(
    photos: Sequence[Path], paths: Sequence[Path], targets: str
) -> Iterator[None]:
    """Write the debug pictures when what the photographs show is refused."""
    try:
        yield
    except ImageError:
        raise  # there was no picture to search
    except TrisquareError as error:
        write_atomically(_findings(photos, paths, targets, error.found, error.rejected))
        raise


def _findings(
    photos: Sequence[Path],
    paths: Sequence[Path],
    targets: str,
    found: Sequence[Place],
    rejected: Sequence[Rejected],
) -> dict[PathLike, bytes]:
    """Draw what was found in each photograph that a path is given for."""
    contents: dict[PathLike, bytes] = {}
    for index, (photo, path) in enumerate(zip(photos, paths, strict=False)):
        image = read_image(photo)
        # An error knows of some pictures already what was passed over in them.
        known = {candidate.corners.tobytes() for candidate in rejected if candidate.image == index}
        passed_over = [
            replace(candidate, image=index)
            for candidate in explain(image, Targets.parse(targets))
            if candidate.corners.tobytes() not in known
        ]
        drawn = draw_findings(image, found, [*rejected, *passed_over], index=index)
        contents[path] = encode_image(drawn, path)
    return contents


@contextmanager
def _progress(photos: int) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on standard error, where somebody may be watching it."""
    console = Console(stderr=True)
    if photos < 2 or not console.is_terminal:
        yield None
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("calibrating", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
