"""Files of text that a user names: an error about one begins with its name."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, TypeAlias

from trisquare._support.terminal_text import printable

File: TypeAlias = str | os.PathLike[str] | IO[Any]
"""A name, or what is open as text or binary."""

MAX_CHARACTERS = 600
"""Of a message: it may cite what a file holds, and that may be anything."""


def open_at_once(path: str, flags: int) -> int:
    """Open a file as ``opener=`` of `open`: a pipe that nobody writes to is then empty."""
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(descriptor, True)  # what is written to a pipe is waited for
    return descriptor


def read_bytes(path: File, most: int = -1) -> bytes:
    """Return what a file holds, `most` bytes of it if that is not negative.

    Raises
    ------
    OSError
        "FILE: why", where Python says "[Errno 2] why: 'FILE'"; also for a device such as
        ``/dev/zero``, of which there may be no end, and for a pipe that nobody writes to.
    TypeError
        If it is neither a name nor open.
    ValueError
        If what is open is closed, or decodes what is no text.
    """
    if not isinstance(path, str | os.PathLike):
        check_open(path, "read")
        try:
            content = path.read(most)
            return content.encode() if isinstance(content, str) else bytes(content)
        except UnicodeError as error:
            raise ValueError(f"{shown(path)}: not a text file") from error
        except ValueError as error:
            raise ValueError(f"{shown(path)}: {error}") from error
    with naming_failure(path):
        with open(path, "rb", opener=open_at_once) as file:
            mode = os.fstat(file.fileno()).st_mode
            if stat.S_ISCHR(mode):
                raise OSError("is a device, not a file")
            content = file.read(most)
        if not content and stat.S_ISFIFO(mode):
            raise OSError("is a pipe that nobody writes to")
        return content


def read_text(path: File) -> str:
    """Return the UTF-8 text of a file.

    Raises
    ------
    OSError
        As `read_bytes`.
    ValueError
        If it holds no text.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{shown(path)}: not a text file") from error


def check_open(file: IO[Any], method: str) -> None:
    """Raise TypeError unless something that is no name is open for a method, "read" or "write"."""
    if not callable(getattr(file, method, None)):
        raise TypeError(f"path must be a name or an open file, not {type(file).__name__}")


def shown(path: File) -> str:
    """Return a file's name as messages have it, control characters escaped: in one line."""
    if not isinstance(path, str | os.PathLike):
        return "the open file"
    return printable(os.fspath(path))


@contextmanager
def naming_failure(path: str | os.PathLike[str]) -> Iterator[None]:
    """Let an OSError read "FILE: why", where Python says "[Errno 2] why: 'FILE'"."""
    try:
        yield
    except OSError as error:
        raise type(error)(f"{shown(path)}: {error.strerror or error}") from error


@contextmanager
def naming(path: File) -> Iterator[None]:
    """Let a ValueError about what a file holds begin with the file's name."""
    try:
        yield
    except ValueError as error:
        message = printable(str(error))  # it may have names that the file holds
        if len(message) > MAX_CHARACTERS:
            message = f"{message[:MAX_CHARACTERS]} ..."
        raise ValueError(f"{shown(path)}: {message}") from error
