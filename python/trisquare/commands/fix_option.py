"""The option `--fix`, which several commands have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, TypeAlias

import typer

from trisquare.commands.completing import completing
from trisquare.settings import FIXABLE

FixOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        metavar="WHAT",
        autocompletion=completing(FIXABLE),
        help="Hold aspect, principal_point, focal or distortion; repeatable, or with commas.",
    ),
]


def fixed_names(fix: Iterable[str] | None) -> tuple[str, ...]:
    """Return the names that the option was given, as `calibrate` takes them."""
    return tuple(name.strip() for names in fix or () for name in names.split(","))
