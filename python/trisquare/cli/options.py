"""What the shell offers for an option's value."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, TypeAlias

import typer

from trisquare._support.arrays import size_of_image
from trisquare.camera.settings import FIXABLE


def completing(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what tells the shell which of these names go on from what is typed already."""
    known = tuple(names)

    def names_from(incomplete: str) -> list[str]:
        return [name for name in known if name.startswith(incomplete)]

    return names_from


def parse_size(text: str) -> tuple[int, int]:
    """Return the width and the height that a text such as ``1280x960`` says.

    Raises
    ------
    ValueError
        If it is written otherwise, or no picture has that size.
    """
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise ValueError(f"a size is written 1280x960, not {text!r}") from error
    return size_of_image((width, height))


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
