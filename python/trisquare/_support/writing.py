"""Writing files whole or not at all."""

from __future__ import annotations

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

PathLike: TypeAlias = str | os.PathLike[str]


class _Terminated(BaseException):
    """SIGTERM came while a file was being written."""


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Let SIGTERM end the process only once the block has removed what it has half written.

    A program that handles it by itself goes on doing so.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def stop(*_: Any) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one would end the removal
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
    """Let an OSError of the system about an output begin with the name that the user gave."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise  # its message is complete
        message = f"{shown(path)}: cannot be written: {error.strerror}"
        raise type(error)(message) from error


def check_writable(path: PathLike) -> None:
    """Raise OSError if `write_atomically` could not write to this path.

    So that a long calibration does not run for an answer that cannot be kept.
    """
    target = Path(os.path.realpath(path))
    with writing(path):
        if not target.parent.is_dir():
            raise FileNotFoundError(f"{shown(path)}: there is no folder {shown(target.parent)}")
        if target.exists() and not target.is_file():
            raise OSError(f"{shown(path)}: is not a file")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise PermissionError(f"{shown(path)}: the folder {shown(target.parent)} is not writable")


@contextmanager
def making_folder(path: PathLike) -> Iterator[None]:
    """Make a folder, with those above it, for what is written in the block.

    If that fails, those that were made are removed again, unless something is in them.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    folder = Path(path)
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
    with ended_in_order():
        try:
            yield
        except BaseException:
            with suppress(OSError):
                for each in made:
                    each.rmdir()
            raise


def write_atomically(contents: Mapping[PathLike, bytes]) -> None:
    """Write files so that each is either complete or untouched.

    Every content goes to a temporary file beside its target first; only when all of them are on
    the disk does the first one take its place.

    Parameters
    ----------
    contents : mapping of path to bytes
        What to write where. A symbolic link is followed, an existing file keeps its mode.

    Raises
    ------
    OSError
        If a file cannot be written; no target was touched then.
    """
    write_in_turn(contents.items())


def write_text(file: File, text: str) -> None:
    """Write a text into what is open, as text or binary; a file of a name as `write_atomically`."""
    if isinstance(file, str | os.PathLike):
        write_atomically({file: text.encode()})
        return
    check_open(file, "write")
    # Text files that wrap others are no TextIOBase.
    is_text = isinstance(file, io.TextIOBase) or hasattr(file, "encoding")
    file.write(text if is_text else text.encode())


@ended_in_order()
def write_in_turn(contents: Iterable[tuple[PathLike, bytes | Callable[[Path], object]]]) -> None:
    """Write files as `write_atomically` does, each content made when its turn has come.

    So that many pictures are never in memory at once; an error while one is made touches no
    target either. A content may also be what writes a file of the path that it is given, which has
    the target's extension.
    """
    staged: list[tuple[PathLike, Path, Path]] = []
    try:
        for path, content in contents:
            check_writable(path)
            target = Path(os.path.realpath(path))
            ending = f".tmp{target.suffix}" if callable(content) else ".tmp"
            temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}{ending}")
            # Opened, not made by tempfile: the file shall have the mode that the umask gives.
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
    """Give a file to be written that takes the place of another once it is whole, on the disk.

    Raises
    ------
    OSError
        If it cannot be written; the other is untouched then.
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
