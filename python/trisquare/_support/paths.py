"""Files of text that a user names: an error about one begins with its name."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MOST_CHARACTERS = 600
"""Of a message: it may cite what a file holds, and that may be anything."""


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Return what a file holds.

    Raises
    ------
    OSError
        "FILE: why", where Python says "[Errno 2] why: 'FILE'"; also for a device such as
        ``/dev/zero``, of which there may be no end.
    """
    try:
        if Path(path).is_char_device():
            raise OSError("is a device, not a file")
        return Path(path).read_bytes()
    except OSError as error:
        raise type(error)(f"{os.fspath(path)}: {error.strerror or error}") from error


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the UTF-8 text of a file.

    Raises
    ------
    OSError
        As `read_bytes`.
    ValueError
        If it holds no text.
    """
    try:
        return read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{os.fspath(path)}: not a text file") from error


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Let a ValueError about what a file holds begin with the file's name."""
    try:
        yield
    except ValueError as error:
        message = str(error)
        if len(message) > MOST_CHARACTERS:
            message = f"{message[:MOST_CHARACTERS]} ..."
        raise ValueError(f"{os.fspath(path)}: {message}") from error
