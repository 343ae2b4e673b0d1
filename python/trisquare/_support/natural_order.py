"""Order of names with numbers: 2.jpg comes before 10.jpg."""

from __future__ import annotations

import os
import re

DIGITS = re.compile(r"([0-9]+)")


def natural_order(name: str | os.PathLike[str]) -> tuple[list[str | int], str]:
    """Return a key for sorting names by the values of their numbers; equal ones sort as text."""
    text = os.fspath(name)
    # Every second part is a number, so that corresponding parts of two names have the same type.
    parts = [int(part) if i % 2 else part for i, part in enumerate(DIGITS.split(text))]
    return parts, text
