"""Output of a command: text, JSON, or nothing."""

from __future__ import annotations

import json as json_text
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

from rich import box
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from trisquare._support.terminal_text import printable
from trisquare.cli.options import as_options
from trisquare.results.calibration_warning import CalibrationWarning

MIN_WIDTH = 80
"""Minimum width of the output, columns: tables would cut numbers where a terminal wraps lines."""

BLANK_END = re.compile(" +$", re.MULTILINE)


def answer(
    json: bool,
    quiet: bool,
    members: Mapping[str, Any] | str,
    parts: Iterable[RenderableType],
    warnings: Iterable[str] = (),
) -> None:
    """Print the result of a command, as text, as JSON with ``--json``, or not with ``--quiet``.

    `members` may already be JSON text, and include the `warnings`, which are otherwise printed to
    standard error. Strings among the `parts` of the text are lines, see `line_of`.
    """
    if json:
        if not isinstance(members, str):
            members = json_text.dumps(members, indent=2, allow_nan=False)
        print(members)
    elif not quiet:
        console = Console()
        console.width = max(console.width, MIN_WIDTH)
        with nullcontext() if console.is_terminal else _without_blank_ends(console):
            for part in parts:
                line = line_of(as_options(part)) if isinstance(part, str) else part
                console.print(line, soft_wrap=True)
        console.file.flush()
        errors = Console(stderr=True)
        for warning in warnings:
            errors.print(line_of(as_options(warning), "yellow"), soft_wrap=True)


@contextmanager
def _without_blank_ends(console: Console) -> Iterator[None]:
    """Remove the blanks at the ends of lines, which tables print, from a file or a pipe."""
    with console.capture() as printed:
        yield
    console.file.write(BLANK_END.sub("", printed.get()))


def texts_and_codes(warnings: Sequence[CalibrationWarning]) -> dict[str, list[str]]:
    """Return the members of a command's JSON with its warnings and, in the same order, codes."""
    return {
        "warnings": [str(warning) for warning in warnings],
        "warning_codes": [warning.code for warning in warnings],
    }


def coded_lines(warnings: Iterable[CalibrationWarning]) -> Iterator[str]:
    """Yield a line for each of a command's warnings, with its code."""
    return (f"warning: {warning} [{warning.code}]" for warning in warnings)


def line_of(text: str, style: str = "") -> Text:
    """Return a line with escaped control characters, which may come from files and names.

    These include line ends, after which a name could imitate the command's output.
    """
    return Text(printable(text), style)


def new_table(*left: str, right: Sequence[str]) -> Table:
    """Return a table with these headings, `left` for columns of text and `right` for numbers."""
    table = Table(*left, box=box.SIMPLE_HEAD)
    for heading in right:
        table.add_column(heading, justify="right")
    return table


@contextmanager
def progress_bar(
    doing: str, quiet: bool, then: str | None = None
) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar on standard error, if it is a terminal, until the work is done.

    Yields a function of the number of items done and their total, or None without a bar. Until it
    is first called, the bar shows only that there is progress. Once all items are done, a second
    bar shows that the work named by `then` is in progress, and for how long.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (
        *(TextColumn("{task.description}"), BarColumn()),
        *(TaskProgressColumn(), TimeElapsedColumn()),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(doing, total=None)

        def tell(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)
            if then is not None and done == total:
                bar.add_task(then, total=None)

        yield tell
