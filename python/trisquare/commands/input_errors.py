"""What is wrong with a file that a command reads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class UnreadableInputError(Exception):
    """A file that was named cannot be read, as a picture may be missing."""


@contextmanager
def reading() -> Iterator[None]:
    """Tell that a file cannot be read from that one cannot be written, both of them OSErrors."""
    try:
        yield
    except OSError as error:
        raise UnreadableInputError(str(error)) from error
