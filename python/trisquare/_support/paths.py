"""Reading of files that a user names, with errors that begin with the name."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, TypeAlias

from trisquare._support.terminal_text import printable
from trisquare._support.worded_errors import worded

File: TypeAlias = str | os.PathLike[str] | IO[Any]
"""A name, or an open text or binary file."""

MAX_CHARACTERS = 600
"""Maximum length of a message: it may quote arbitrary content of a file."""


def open_at_once(path: str, flags: int) -> int:
    """Open a file as ``opener=`` of `open`; a pipe without a writer is then empty."""
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(descriptor, True)  # reading waits for the writer of a pipe
    return descriptor


def read_bytes(path: File, most: int = -1) -> bytes:
    """Return the content of a file, at most `most` bytes if that is not negative.

    Raises
    ------
    OSError
        With the message "FILE: why", where Python has "[Errno 2] why: 'FILE'"; also for a device
        such as ``/dev/zero``, which may be endless, and for a pipe without a writer.
    TypeError
        If it is neither a name nor an open file.
    ValueError
        If an open file is closed, or decodes content that is not text.
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
            raise OSError("is a pipe that no program writes to")
        return content


def read_text(path: File) -> str:
    """Return the UTF-8 text of a file.

    Raises
    ------
    OSError
        As `read_bytes`.
    ValueError
        If it is not text.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{shown(path)}: not a text file") from error


def check_open(file: IO[Any], method: str) -> None:
    """Raise TypeError unless an object is open for a method, "read" or "write"."""
    if not callable(getattr(file, method, None)):
        raise TypeError(f"path must be a name or an open file, not {type(file).__name__}")


def shown(path: File) -> str:
    """Return a file's name for messages, in one line with escaped control characters."""
    if not isinstance(path, str | os.PathLike):
        return "the open file"
    return printable(os.fspath(path))


@contextmanager
def naming_failure(path: str | os.PathLike[str]) -> Iterator[None]:
    """Change the message of an OSError from "[Errno 2] why: 'FILE'" to "FILE: why".

    Its ``errno``, ``strerror`` and ``filename`` are kept.
    """
    try:
        yield
    except OSError as error:
        text = f"{shown(path)}: {error.strerror or error}"
        raise worded(type(error), text, path, error.errno, error.strerror) from error


@contextmanager
def naming(path: File) -> Iterator[None]:
    """Prefix the message of a ValueError about a file's content with the file's name."""
    try:
        yield
    except ValueError as error:
        message = printable(str(error))  # it may contain names from the file
        if len(message) > MAX_CHARACTERS:
            message = f"{message[:MAX_CHARACTERS]} ..."
        raise ValueError(f"{shown(path)}: {message}") from error
