"""What a command prints: text, JSON, or nothing."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

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
