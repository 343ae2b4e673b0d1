"""The `trisquare` command.

Exit codes: 0 done; 2 usage, bad argument, damaged file or unwritable output; 3 nothing found, or
not enough of it; 4 the geometry does not determine the camera, or no convergence; 5 a picture or
another file is missing or unreadable; 6 cameras of a batch failed or are beyond the limits, or a
checked sheet is not ok. Every error is one line on standard error; then no file is written except
those of `--debug-image`, and outputs beside one that could not be written. With ``--json`` the line
is a JSON object, of the format ``trisquare-error/1``.
a JSON object, of the format ``trisquare-error/1``.

Further codes, as of other commands: 1 if standard output is no longer read (``| head``),
130 after Ctrl-C, and 70 after an internal error.
"""

from __future__ import annotations

import json
import os
import re
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import TextIOWrapper
from typing import Any, NoReturn

import typer

from trisquare._core import __version__
from trisquare._support.suggestions import nearest_name
from trisquare._support.terminal_text import printable
from trisquare._support.worded_errors import WordedOSError
from trisquare.cli.framework import CommandGroup, UnreadableInputError
from trisquare.cli.options import as_options, flag
from trisquare.errors import (
    ConvergenceError,
    DegenerateGeometryError,
    DetectionError,
    ImageError,
    InternalError,
    NotEnoughDataError,
    NotEnoughPlanesError,
    code_members,
    error_members,
    lacks_memory,
)

CLOSED_PIPE_EXIT = 1  # as in Python's documentation and in rich
USAGE_EXIT = 2
FAULT_EXIT = 70  # EX_SOFTWARE of sysexits.h
INTERRUPTED_EXIT = 130  # the code that shells report for a process ended by Ctrl-C
EXIT_CODES: Mapping[type[Exception], int] = {
    ImageError: 5,  # also if it is an OSError
    ValueError: USAGE_EXIT,
    TypeError: USAGE_EXIT,
    OSError: USAGE_EXIT,
    ImportError: USAGE_EXIT,  # an extra is not installed
    DetectionError: 3,
    NotEnoughPlanesError: 3,
    NotEnoughDataError: 3,
    DegenerateGeometryError: 4,
    ConvergenceError: 4,
    UnreadableInputError: 5,
}

LIMIT_OPTIONS = {"--max-pixels", "--max-bytes"}

DASHED = re.compile(r"-[^-]")
"""Start of a negative number, or of a file's name, which the parser takes for an option."""

OPTIONS_ELSEWHERE = {"--square-size": "--side"}
"""Names of options in other programs, and the options here, for commands that have them."""

TRACEBACK_VARIABLE = "TRISQUARE_TRACEBACK"
"""Environment variable that enables the traceback of an internal error."""

# Base class of the parser's errors: in Click for older Typers, in a copy of Click for newer ones.
UsageError: type[Any] = typer.BadParameter.__mro__[1]

ERROR_FORMAT = "trisquare-error/1"

app = typer.Typer(
    cls=CommandGroup,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help=("Calibrate a camera from one photograph of three squares, and use the calibration."),
)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit; `arguments` defaults to those of the process."""
    _silence_opencv()
    _let_output_show_any_name()
    words = sys.argv[1:] if arguments is None else arguments
    fail = _fail_in_json if "--json" in words else _fail
    if "" in words:
        fail("UsageError", "an argument is empty: is a variable of the shell not set?", USAGE_EXIT)
    try:
        code = typer.main.get_command(app).main(words, prog_name="trisquare", standalone_mode=False)
        _flush_output()
    except UsageError as error:
        fail("UsageError", _usage_message(error), USAGE_EXIT)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED_EXIT
    except BrokenPipeError:
        _drop_output()
        code = CLOSED_PIPE_EXIT
    except tuple(EXIT_CODES) as error:
        family = next(kind for kind in EXIT_CODES if isinstance(error, kind))
        is_input = family is UnreadableInputError
        code_name = family.__name__ if is_input else error_members(error)["code"]
        fail(code_name, _message(error, words), EXIT_CODES[family])
    except SystemExit:
        raise
    except BaseException as error:  # a panic of the core is not an Exception
        fail(error_members(error)["code"], _fault_message(error), FAULT_EXIT)
    # Newer Typers return the code of Ctrl-C, older ones raise Abort.
    if code == INTERRUPTED_EXIT:
        fail("KeyboardInterrupt", "interrupted", INTERRUPTED_EXIT)
    sys.exit(code if isinstance(code, int) else 0)


def _silence_opencv() -> None:
    """Suppress the messages of OpenCV and its FFmpeg beside the error of the command."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET
    if "cv2" not in sys.modules:  # it must not be loaded only for this
        os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
        return
    import cv2

    silent = 0
    # OpenCV 5 moved the function.
    set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel
    set_level(silent)


def _let_output_show_any_name() -> None:
    """Escape what standard output cannot encode, such as file names, as standard error does."""
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _flush_output() -> None:
    """Flush standard output, so that a full disk or a closed pipe is an error before the exit."""
    if sys.stdout is not None:  # it is None if it was closed: trisquare >&-
        sys.stdout.flush()


def _drop_output() -> None:
    """Redirect standard output, so that the interpreter does not fail to flush it at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _usage_message(error: Any) -> str:
    context = getattr(error, "ctx", None)
    path = "trisquare" if context is None else context.command_path
    message = error.format_message()
    option = getattr(error, "option_name", None) or ""
    parameters = () if context is None else context.command.params
    elsewhere = OPTIONS_ELSEWHERE.get(option)
    if elsewhere is not None and any(elsewhere in each.opts for each in parameters):
        suggestion: str | None = elsewhere
    else:
        suggestion = nearest_name(option, getattr(error, "possibilities", None) or ())
    if option and context is not None and context.parent is None:
        message = f"No such option: {option}; options of a command come after its name"
    elif suggestion is not None:
        message = f"No such option: {option}. Did you mean {suggestion}?"
    elif DASHED.match(option):
        message = f"{message}; put -- before arguments that begin with a minus"
    elif message.startswith("Missing option '--camera'"):
        message = "Missing option '--camera': the camera's file is named by --camera FILE"
    return f"{message} (see {path} --help)"


def _message(error: Exception, words: Sequence[str]) -> str:
    """Return an error's message, for errors of the system without their number.

    A limit has the name of its option if that is among the words of the command line; most commands
    have none, and take limits from the environment.
    """
    if isinstance(error, OSError) and not isinstance(error, WordedOSError) and error.strerror:
        # An error without a file's name is about standard output.
        return f"{error.filename or 'standard output'}: {error.strerror}"
    message = as_options(str(error)) or type(error).__name__
    typed = {word.partition("=")[0] for word in words} & LIMIT_OPTIONS
    for option in typed:
        message = message.replace(f"{option[2:].replace('-', '_')} allows", f"{option} allows")
    return message


def _fault_message(error: BaseException) -> str:
    """Return the message of an internal error; print the traceback first if that is enabled."""
    if os.environ.get(TRACEBACK_VARIABLE):
        traceback.print_exception(error)
    elif lacks_memory(error):
        return str(error_members(error)["text"])
    elif isinstance(error, InternalError):
        return str(error)
    return (
        f"internal error, please report it: {type(error).__name__}: {error} "
        f"({TRACEBACK_VARIABLE}=1 shows where)"
    )


def _fail(kind: str, message: str, exit_code: int) -> NoReturn:
    """Print an error in one line, and exit."""
    _exit_with(f"trisquare: error: {printable(' '.join(message.split()))}", exit_code)


def _fail_in_json(kind: str, message: str, exit_code: int) -> NoReturn:
    """Print an error as a JSON object in one line, and exit."""
    error = {**code_members(kind, message), "exit_code": exit_code}
    _exit_with(json.dumps({"format": ERROR_FORMAT, "error": error}), exit_code)


def _exit_with(line: str, exit_code: int) -> NoReturn:
    with suppress(OSError):  # standard error is not read: only the exit code is left
        print(line, file=sys.stderr)
    try:
        _flush_output()
    except OSError:
        _drop_output()
    sys.exit(exit_code)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"trisquare {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: bool = flag("Print version.", "--version", callback=_print_version, is_eager=True),
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())
