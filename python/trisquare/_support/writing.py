"""Writing of files, completely or not at all."""

from __future__ import annotations

import errno
import io
import os
import secrets
import shutil
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, TypeAlias

from trisquare._support.paths import File, check_open, shown
from trisquare._support.worded_errors import WordedOSError, worded

PathLike: TypeAlias = str | os.PathLike[str]


class _Terminated(BaseException):
    """SIGTERM arrived while a file was being written."""


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Delay the end of the process by SIGTERM until the block has removed incomplete files.

    The handler of a program that handles SIGTERM itself is kept.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def stop(*_: Any) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one would interrupt the removal
        raise _Terminated

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except _Terminated:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.raise_signal(signal.SIGTERM)
    finally:
        if signal.getsignal(signal.SIGTERM) is stop:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def writing(path: PathLike) -> Iterator[None]:
    """Prefix the message of a system's OSError about an output with the user's name for it."""
    try:
        yield
    except OSError as error:
        if isinstance(error, WordedOSError) or error.errno is None:
            raise  # its message is complete
        message = f"{shown(path)}: cannot be written: {error.strerror}"
        raise worded(type(error), message, path, error.errno, error.strerror) from error


def check_writable(path: PathLike) -> None:
    """Raise OSError if `write_atomically` could not write to this path, TypeError if it is none.

    To be called before a long calibration, whose result could otherwise be lost.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file's name, not {type(path).__name__}")
    target = Path(os.path.realpath(path))
    with writing(path):
        if not target.parent.is_dir():
            text = f"{shown(path)}: there is no folder {shown(target.parent)}"
            raise worded(FileNotFoundError, text, path, errno.ENOENT)
        if target.exists() and not target.is_file():
            number = errno.EISDIR if target.is_dir() else None
            raise worded(OSError, f"{shown(path)}: is not a file", path, number)
    if not os.access(target.parent, os.W_OK | os.X_OK):
        text = f"{shown(path)}: the folder {shown(target.parent)} is not writable"
        raise worded(PermissionError, text, path, errno.EACCES)


@contextmanager
def making_folder(path: PathLike) -> Iterator[None]:
    """Create a folder, and missing parents, for files written in the block.

    If the block fails, the created folders are removed again, unless they are not empty.

    Raises
    ------
    OSError
        If it cannot be created.
    """
    folder = Path(path)
    made = [
        folder_to_remove
        for folder_to_remove in (folder, *folder.parents)
        if not folder_to_remove.exists()
    ]
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
    with ended_in_order():
        try:
            yield
        except BaseException:
            with suppress(OSError):
                for folder_to_remove in made:
                    folder_to_remove.rmdir()
            raise


def write_atomically(contents: Mapping[PathLike, bytes]) -> None:
    """Write files so that each is either complete or untouched.

    Every content is first written to a temporary file in the folder of its target; only when all
    are on the disk do they replace their targets.

    Parameters
    ----------
    contents : mapping of path to bytes
        Content by path. A symbolic link is followed, an existing file keeps its mode.

    Raises
    ------
    OSError
        If a file cannot be written; no target was changed then.
    """
    write_in_turn(contents.items())


def write_text(file: File, text: str) -> None:
    """Write a text to an open text or binary file, or to a named one as `write_atomically`."""
    if isinstance(file, str | os.PathLike):
        write_atomically({file: text.encode()})
        return
    check_open(file, "write")
    # Text files that wrap others are not instances of TextIOBase.
    is_text = isinstance(file, io.TextIOBase) or hasattr(file, "encoding")
    file.write(text if is_text else text.encode())


@ended_in_order()
def write_in_turn(contents: Iterable[tuple[PathLike, bytes | Callable[[Path], object]]]) -> None:
    """Write files as `write_atomically` does, with each content created only when it is written.

    Therefore only one of many pictures is in memory at a time; an error while one is created leaves
    all targets untouched. A content may also be a function that writes the file at a given path,
    which has the target's extension.
    """
    staged: list[tuple[PathLike, Path, Path]] = []
    try:
        for path, content in contents:
            check_writable(path)
            target = Path(os.path.realpath(path))
            ending = f".tmp{target.suffix}" if callable(content) else ".tmp"
            temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}{ending}")
            # Not created by tempfile, so that the file has the mode of the umask.
            with writing(path):
                with temporary.open("xb") as file:
                    staged.append((path, temporary, target))
                    if not callable(content):
                        file.write(content)
                if callable(content):
                    content(temporary)
                with temporary.open("r+b") as file:
                    os.fsync(file.fileno())
            if target.exists():
                shutil.copymode(target, temporary)
        for path, temporary, target in staged:
            with writing(path):
                temporary.replace(target)
    finally:
        for _, temporary, _ in staged:
            temporary.unlink(missing_ok=True)


@contextmanager
def replacing(path: PathLike) -> Iterator[BinaryIO]:
    """Yield a file to write, which replaces the target once it is complete and on the disk.

    Raises
    ------
    OSError
        If it cannot be written; the target is untouched then.
    """
    check_writable(path)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    with ended_in_order():
        try:
            with writing(path):
                with temporary.open("xb") as file:
                    yield file
                    file.flush()
                    os.fsync(file.fileno())
                temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
