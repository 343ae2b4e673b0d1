"""Errors of the system with a sentence of trisquare's as their text."""

from __future__ import annotations

import os
from functools import cache
from typing import Any


class WordedOSError(OSError):
    """An error of the system whose text is a sentence of trisquare's, beside the system's members.

    An `OSError` with an ``errno`` has the text "[Errno 2] why: 'FILE'". To be created by `worded`.
    """

    def __init__(
        self,
        text: str,
        filename: str | os.PathLike[str] | None = None,
        number: int | None = None,
        strerror: str | None = None,
    ) -> None:
        super().__init__(text)
        self.filename = None if filename is None else os.fspath(filename)
        self.errno = number
        self.strerror = os.strerror(number) if strerror is None and number else strerror

    def __str__(self) -> str:
        return str(self.args[0])

    def __reduce__(self) -> tuple[Any, ...]:
        members = (str(self), self.filename, self.errno, self.strerror)
        return worded, (getattr(self, "system_kind", type(self)), *members), self.__dict__


@cache
def _worded_kind(kind: type[OSError]) -> type[WordedOSError]:
    """Return a subclass of one of the system's errors, with the same name."""
    if issubclass(kind, WordedOSError):
        return kind
    members = {"__module__": kind.__module__, "__doc__": kind.__doc__, "system_kind": kind}
    return type(kind.__name__, (WordedOSError, kind), members)


def worded(
    kind: type[OSError],
    text: str,
    filename: str | os.PathLike[str] | None = None,
    number: int | None = None,
    strerror: str | None = None,
) -> WordedOSError:
    """Return an error of a class of the system's, with a text and with the system's members.

    Parameters
    ----------
    kind : type of OSError
        The error is an instance of it.
    text : str
        The message.
    filename : str or path, optional
        The file.
    number : int, optional
        Its ``errno``.
    strerror : str, optional
        By default the system's text for the number.
    """
    known = _worded_kind(kind)  # type: ignore[arg-type]  # a class is hashable
    return known(text, filename, number, strerror)
