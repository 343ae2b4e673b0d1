"""Names and aspects of the rectangles to search for."""

from __future__ import annotations

import re
from dataclasses import dataclass

NAMED_ASPECTS = {
    "a4": 2.0**0.5,
    "letter": 11.0 / 8.5,
    "card": 85.60 / 53.98,
    "16:9": 16.0 / 9.0,
}
"""Aspects by name: ISO 216, ANSI/ASME Y14.1, ISO/IEC 7810 ID-1, ITU-R BT.709."""

MIN_ASPECT = 1.2
"""Minimum aspect other than 1: below it, which way up a rectangle is cannot be seen."""

MAX_ASPECT = 10.0
"""Maximum aspect: a longer strip gives next to no information across."""


@dataclass(frozen=True, slots=True)
class RectangleShape:
    """Shape of the rectangles to search for: longer side over shorter, or None for any."""

    aspect: float | None

    @classmethod
    def parse(cls, text: str) -> RectangleShape | None:
        """Read ``a4``, ``letter``, ``card``, ``16:9``, ``rectangle`` or ``rectangle:1.5``.

        Return None for the name of anything else.

        Raises
        ------
        ValueError
            For an invalid aspect.
        """
        if text in NAMED_ASPECTS:
            return cls(NAMED_ASPECTS[text])
        if text == "rectangle":
            return cls(None)
        if not text.startswith("rectangle:"):
            return None
        given = text.removeprefix("rectangle:")
        match = re.fullmatch(r"(\d+(?:\.\d*)?)(?:[:/](\d+(?:\.\d*)?))?", given)
        width, height = (float(match[1]), float(match[2] or 1.0)) if match else (0.0, 0.0)
        if min(width, height) <= 0.0:
            raise ValueError(f"{text!r}: the aspect must be a number such as 1.4142, or 16:9")
        aspect = max(width, height) / min(width, height)
        if 1.0 < aspect < MIN_ASPECT:
            raise ValueError(
                f"{text!r}: below an aspect of {MIN_ASPECT:g} the orientation of a rectangle "
                "cannot be seen: give PlaneEdges.rectangle with its sides"
            )
        if aspect > MAX_ASPECT:
            raise ValueError(f"{text!r}: the aspect may be {MAX_ASPECT:g} at most")
        return cls(aspect)
