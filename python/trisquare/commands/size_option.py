"""The size of a picture, as several commands take it."""

from __future__ import annotations

from trisquare.checked import size_of_image


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
