"""Descriptions of arguments and options of the commands, and parsing of some values."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import typer

from trisquare._support.arrays import size_of_image
from trisquare.camera.settings import FIXABLE, FREEABLE
from trisquare.images.limits import parse_amount

STANDARD_INPUT = "-"
"""Argument for standard input among photographs, as in other programs."""

KEYWORD = re.compile(r"""\b(fix|free|model|method|targets|tone)=["']([^"'\s]+)["']""")
"""A keyword of `calibrate` with its value; the option has the same name."""

NAME_ALONE = re.compile(
    r"\b(fix|free|initial|model|orthogonal|parallel|side|targets|tone)=(?=[\s,;:.)]|$)"
)
"""A keyword without a value, as it occurs in messages."""


def _refuse_input(context: typer.Context, value: Any) -> Any:
    """Refuse the name ``-`` where it would be a file of that name."""
    names = value if isinstance(value, list) else [value]
    if STANDARD_INPUT in map(str, names):
        raise ValueError(f"-: {context.command_path} does not read standard input: name a file")
    return value


def argument(default: Any, metavar: str, text: str, *, allows_dash: bool = False) -> Any:
    """Return the description of an argument, used as a parameter's default; ``...`` for none.

    Unless it `allows_dash`, it is a file to be read, which ``-`` is not.
    """
    # A file that cannot be read is reported as an error of the input, not of the command line.
    callback = None if allows_dash else _refuse_input
    return typer.Argument(default, metavar=metavar, help=text, readable=False, callback=callback)


def option(default: Any, metavar: str, text: str, *names: str, offer: Iterable[str] = ()) -> Any:
    """Return the description of an option, as `argument`; shells complete the values `offer`."""
    known = tuple(offer)

    def offered(incomplete: str) -> list[str]:
        return [value for value in known if value.startswith(incomplete)]

    return typer.Option(
        default, *names, metavar=metavar, help=text, autocompletion=offered, readable=False
    )


def flag(text: str, *names: str, **more: Any) -> Any:
    """Return the description of an option without a value; `more` is passed to `typer.Option`."""
    return typer.Option(False, *names, help=text, **more)


OF_PHOTOS = (
    "One photograph, or several of the same camera; or a folder (without its subfolders), or a "
    "pattern such as '*.jpg' or '**/*.jpg', in the order of names (2.jpg before 10.jpg)"
)
PHOTOS = argument(..., "PHOTO", f"{OF_PHOTOS}.")
PHOTOS_OR_INPUT = argument(..., "PHOTO", f"{OF_PHOTOS}; or - for standard input.", allows_dash=True)
JSON = flag("Print JSON instead of text, and nothing else.", "--json")
QUIET = flag("Print nothing but errors.", "--quiet", "-q")
FIX = option(
    None,
    "WHAT",
    "Fix aspect, principal_point, focal or distortion at the values of --initial, or else at 1, "
    "the picture's centre, and zero; repeatable, or with commas.",
    offer=FIXABLE,
)
FRAMES = option(
    None,
    "N",
    "Calibrate with N frames of each video, those in folders included: sharp ones that differ.",
)
INITIAL = option(
    None,
    "FILE",
    "A camera, in any format that convert reads: --fix takes its values, and --fix focal needs "
    "it; the fit of the free parameters may start from them.",
)
FREE = option(
    None, "WHAT", "Estimate the skew, which is otherwise fixed at zero: skew.", offer=FREEABLE
)

ORTHOGONAL = option(
    None,
    "PLANES",
    "Two planes that are at right angles, as 0,1: their numbers in the result; repeatable.",
)
PARALLEL = option(None, "PLANES", "Two planes that are parallel, as 0,1; repeatable.")
MAX_PIXELS = option(None, "N", "Refuse pictures whose header states more pixels (500M).")
MAX_BYTES = option(None, "N", "Refuse larger files (2G).")
BALANCE = option(0.0, "0..1", "From 0 (no black border) to 1 (all of the photograph).")


def amount(text: str | None, name: str) -> float | None:
    """Return the number of an option such as ``500M``; None if it was not given."""
    return None if text is None else parse_amount(text, name)


def parse_pairs(texts: Iterable[str] | None) -> list[tuple[int, int]]:
    """Return the pairs of planes in texts such as ``0,1``.

    Raises
    ------
    ValueError
        If a text is in another form.
    """
    pairs = []
    for text in texts or ():
        try:
            first, second = (int(part) for part in text.split(","))
        except ValueError as error:
            raise ValueError(f"two planes are written 0,1, not {text!r}") from error
        pairs.append((first, second))
    return pairs


def parse_size(text: str) -> tuple[int, int]:
    """Return the width and the height in a text such as ``1280x960``.

    Raises
    ------
    ValueError
        If it is in another form, or no picture can have that size.
    """
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise ValueError(f"a size is written 1280x960, not {text!r}") from error
    return size_of_image((width, height))


def as_options(message: str) -> str:
    """Replace keywords in a message by options: ``--fix aspect`` for ``fix="aspect"``."""
    message = KEYWORD.sub(r"--\1 \2", message)
    return NAME_ALONE.sub(r"--\1", message.replace("lines=True", "--lines"))


def listed_names(fix: Iterable[str] | None) -> tuple[str, ...]:
    """Return the names in an option's values, in the form for `calibrate`."""
    return tuple(name.strip() for names in fix or () for name in names.split(","))
