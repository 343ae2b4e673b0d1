"""A bar that shows that a command is at work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress


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
