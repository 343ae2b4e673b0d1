"""Text from files and their names, as a terminal may be given it."""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    """Return a text in one line whose control characters are escaped."""
    return "".join(
        letter.encode("unicode_escape").decode("ascii")
        if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp")
        else letter
        for letter in text
    )
