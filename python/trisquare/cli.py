"""The `trisquare` command.

Exit codes: 0 done; 2 usage, bad argument or unwritable output; 3 nothing found, or not enough of
it; 4 the geometry does not determine the camera, or no convergence; 5 unreadable picture. Every
error is one line on standard error, and no file is written then but what `--debug-image` asks for.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NoReturn

import cv2
import typer

from trisquare._core import __version__
from trisquare.commands.calibrate import calibrate_command
from trisquare.commands.compare import compare_command
from trisquare.commands.demo import demo_command
from trisquare.commands.predict import predict_command
from trisquare.commands.target import target_command
from trisquare.commands.undistort import undistort_command
from trisquare.errors import (
    ConvergenceError,
    DegenerateGeometryError,
    DetectionError,
    ImageError,
    NotEnoughDataError,
    NotEnoughPlanesError,
)

USAGE_EXIT = 2
INTERRUPTED_EXIT = 130  # what shells report for a process ended by Ctrl-C
EXIT_CODES: Mapping[type[Exception], int] = {
    ValueError: USAGE_EXIT,
    TypeError: USAGE_EXIT,
    OSError: USAGE_EXIT,
    ImportError: USAGE_EXIT,  # what an extra brings
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


app.command("calibrate")(calibrate_command)
app.command("predict")(predict_command)
app.command("compare")(compare_command)
app.command("target")(target_command)
app.command("undistort")(undistort_command)
app.command("demo")(demo_command)
