"""What a command prints: text, JSON, or nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, TypeAlias

import typer
from rich.console import Console
from rich.progress import Progress

JsonOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print JSON instead of text, and nothing else.")
]

QuietOption: TypeAlias = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")
]


def check_printing(json: bool, quiet: bool) -> None:
    """Refuse to print and to be quiet at once.

    Raises
    ------
    ValueError
        If both are asked for.
    """
    if json and quiet:
        raise ValueError("--json prints, and --quiet does not: give one of them")


@contextmanager
def progress_bar(doing: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on standard error, where somebody may be watching it, until the work is done.

    Yields what is to be told how much of how much is done, or None where nobody watches. Until it
    is told, the bar only shows that something is done.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(doing, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
