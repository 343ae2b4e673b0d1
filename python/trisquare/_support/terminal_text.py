"""Escaping of text from files and their names for output on a terminal."""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    """Return a text with escaped control characters, in one line."""
    return "".join(
        letter.encode("unicode_escape").decode("ascii")
        if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp")
        else letter
        for letter in text
    )
