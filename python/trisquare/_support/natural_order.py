"""The order of names that hold numbers: 2.jpg comes before 10.jpg."""

from __future__ import annotations

import os
import re

DIGITS = re.compile(r"([0-9]+)")


def natural_order(name: str | os.PathLike[str]) -> tuple[list[str | int], str]:
    """Return a key to sort names by, in which digits count as numbers; equal ones sort as text."""
    text = os.fspath(name)
    # Every second part is a number, so that parts of two names that are compared are of one type.
    parts = [int(part) if i % 2 else part for i, part in enumerate(DIGITS.split(text))]
    return parts, text
