"""Commands of `trisquare`, which are loaded on demand."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from types import MappingProxyType
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from trisquare._support.suggestions import nearest_name
from trisquare.errors import ImageError

SUMMARIES: Mapping[str, str] = MappingProxyType(
    {
        "calibrate": "Calibrate a camera from its photographs.",
        "batch": (
            "Calibrate many cameras, each from its own photographs; an interrupted run continues."
        ),
        "serve": (
            "Serve a page that calibrates cameras in a browser, from files or from its own camera."
        ),
        "predict": "Predict the standard deviations that a planned photograph will have.",
        "measure": "Measure lengths, angles and areas on the plane of a square.",
        "compare": (
            "Compare two cameras: how far apart they project, and whether uncertainties explain it."
        ),
        "target": "Write a PDF of three frames, or chessboards, to print; or check a printed one.",
        "undistort": (
            "Remove the lens distortion from photographs and videos; none is written unless all "
            "can be."
        ),
        "straighten": (
            "Remove the lens distortion from a photograph by its straight lines, without a target."
        ),
        "convert": "Convert a camera from one program's file format to another's.",
        "demo": (
            "Calibrate the bundled photograph and compare with the camera that it was made with."
        ),
    }
)
"""Summary of each command, in the order of the help.

The command ``x`` is the function ``x_command`` of the module ``x`` in this folder, whose `EXAMPLES`
end its help. The summaries repeat the first lines of the docstrings, because ``trisquare --help``
would otherwise import OpenCV and all other modules for a screen of text.
"""

EXIT_CODES_HELP = """\
0  done
2  wrong usage or argument, a damaged file (other than a picture), or unwritable output
3  nothing found in the photograph, or not enough of it
4  the geometry does not determine the camera, or no convergence
5  a picture or a file is missing or cannot be read
6  batch: cameras failed or are beyond the limits; target: something is not ok in the checked sheet;
   calibrate: a warning has at least the severity that was stated as a failure
1, 70, 130  nobody reads the output; internal error; Ctrl-C"""

NOT_ALL_PASSED_EXIT = 6


@contextmanager
def _escaped_help(parameters: Iterable[Any]) -> Iterator[None]:
    """Escape brackets of help texts, such as ``trisquare[report]``: Typer takes them for styles."""
    texts = [(each, each.help) for each in parameters if getattr(each, "help", None)]
    for parameter, text in texts:
        parameter.help = text.replace("[", r"\[")
    try:
        yield
    finally:
        for parameter, text in texts:
            parameter.help = text


class HelpEndingWithExamples:
    """Mixin that ends the help of a command, and of `trisquare`, with examples and exit codes."""

    examples: tuple[str, ...] = ()

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help; text written to the formatter follows what Typer prints directly."""
        with _escaped_help(self.params):  # type: ignore[attr-defined]
            super().format_help(ctx, formatter)  # type: ignore[misc]  # the command class is next
        endings = ("Examples", self.examples), ("Exit codes", EXIT_CODES_HELP.splitlines())
        for heading, lines in endings:
            formatter.write(f" {heading}:\n")
            formatter.write("".join(f"   {line}\n" for line in lines))
            formatter.write("\n")


class HelpfulCommand(HelpEndingWithExamples, TyperCommand):
    """A command with output as JSON, text or nothing."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command, but refuse ``--json`` together with ``--quiet``."""
        if ctx.params["json"] and ctx.params["quiet"]:
            raise ValueError("--json prints, and --quiet does not: give one of them")
        return super().invoke(ctx)


ELSEWHERE = {
    "detect": "calibrate PHOTO --debug-image FILE",
    "diagnose": "calibrate PHOTO --diagnose",
    "rectify": "measure PHOTO --camera FILE --rectify FILE",
    "report": "calibrate PHOTO --report FILE",
}
"""Functions of the library that are options of commands."""


class CommandGroup(HelpEndingWithExamples, TyperGroup):
    """The group of all commands, which lists them by summary and loads the one that runs."""

    examples = (
        "trisquare demo",
        "trisquare target -o target.pdf",
        "trisquare calibrate photo.jpg -o camera.json --overlay overlay.png",
        "trisquare undistort photo.jpg --camera camera.json -o straight.png",
    )

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, summary in SUMMARIES.items():
            self.commands[name] = TyperCommand(name, help=summary)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Replace the summary of a command by the command itself."""
        name = args[0]
        if name in SUMMARIES:
            if not isinstance(self.commands[name], HelpfulCommand):
                self.commands[name] = load_command(name)
        elif not ctx.resilient_parsing and (advice := _advice_for(name)):
            ctx.fail(f"No such command {name!r}{advice}")
        return super().resolve_command(ctx, args)


def _advice_for(word: str) -> str:
    """Return advice on a word that is not a command; empty if there is none."""
    if word in ELSEWHERE:
        return f": it is 'trisquare {ELSEWHERE[word]}'."
    if os.path.exists(word):
        return f": it is 'trisquare calibrate {word}', or another."
    suggestion = None if word.startswith("-") else nearest_name(word, SUMMARIES)
    return "" if suggestion is None else f". Did you mean {suggestion!r}?"


def load_command(name: str) -> HelpfulCommand:
    """Import a command named in `SUMMARIES`."""
    module = import_module(f"trisquare.cli.{name}")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(name, cls=HelpfulCommand)(getattr(module, f"{name}_command"))
    command = typer.main.get_command(app)
    assert isinstance(command, HelpfulCommand)
    command.examples = module.EXAMPLES
    # Typer would keep the source's line breaks in all paragraphs but the first.
    paragraphs = (command.help or "").split("\n\n")
    command.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
    return command


def command_line(context: typer.Context) -> str:
    """Return a command line, quoted for a shell, that repeats the command.

    It differs from the one that was given: options are put before arguments and have their long
    names, and options with default values are left out.
    """
    options: list[str] = []
    arguments: list[str] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        texts = [str(one) for one in (value if isinstance(value, list | tuple) else [value])]
        if parameter.param_type_name == "argument":
            arguments += texts
        elif value != parameter.get_default(context) and value is not False and value is not None:
            # The longest of several names (--output, -o) is the most informative.
            name = max(parameter.opts, key=len)
            options += [name] if value is True else [w for text in texts for w in (name, text)]
    return shlex.join([*context.command_path.split(), *options, *arguments])


class UnreadableInputError(Exception):
    """An input file cannot be read, for example because it is missing."""


@contextmanager
def reading() -> Iterator[None]:
    """Distinguish files that cannot be read from outputs that cannot be written, both OSErrors."""
    try:
        yield
    except ImageError:
        raise  # a missing picture is also an OSError
    except OSError as error:
        raise UnreadableInputError(str(error)) from error
