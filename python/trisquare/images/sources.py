"""The pictures that are given: one or several, files, folders or patterns."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from trisquare._support.natural_order import natural_order
from trisquare._support.paths import shown
from trisquare.errors import ImageError, MissingImageError
from trisquare.images.drawn_mark import is_drawn
from trisquare.images.pixels import ImageSource, PillowImage

PICTURE_SUFFIXES = frozenset(
    (
        *(".jpg", ".jpeg", ".jpe", ".jp2", ".png", ".tif", ".tiff", ".bmp", ".webp", ".avif"),
        *(".gif", ".pgm", ".ppm", ".pbm", ".pnm"),
        *(".heic", ".heif", ".hif"),
        *(".dng", ".arw", ".cr2", ".cr3", ".nef", ".orf", ".pef", ".raf", ".rw2", ".srw"),
    )
)
"""Extensions of files in folders that are taken for photographs, in any case of letters."""

VIDEO_SUFFIXES = frozenset(
    (
        *(".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts"),
        *(".3gp", ".wmv", ".flv", ".ogv"),
    )
)
"""The same for videos, if frames are chosen from them."""


def sources_of(
    image: ImageSource | Iterable[ImageSource], *, with_videos: bool = False
) -> list[ImageSource]:
    """Return the pictures, one or several, as a list.

    A folder stands for the pictures directly in it that are not hidden, and `with_videos` for its
    videos as well; a pattern such as ``frame-*.png`` stands for the files that match. Both leave
    out files that trisquare has drawn on. They are in the order of their names, with numbers in
    numerical order: ``2.jpg`` comes before ``10.jpg``. Open files are read, since that can be done
    only once.

    Raises
    ------
    ImageError
        If a folder contains no picture, or an open file cannot be read; `MissingImageError` if a
        file does not exist, or no file matches a pattern.
    TypeError
        If a file is open as text.
    """
    if is_one_picture(image) or not isinstance(image, Iterable):
        return _expanded(image, with_videos)
    return [picture for source in image for picture in _expanded(source, with_videos)]


def content_of(file: Any) -> bytes:
    """Read an open file to its end.

    Raises
    ------
    ImageError
        If it cannot be read.
    TypeError
        If it is open as text.
    """
    try:
        content = file.read()
    except OSError as error:
        raise ImageError(f"the open file: {error.strerror or error}") from error
    except UnicodeDecodeError:
        content = ""
    if not isinstance(content, bytes | bytearray | memoryview):
        raise TypeError('a picture\'s file must be open as binary: open(name, "rb")')
    return bytes(content)


def is_one_picture(source: object) -> TypeGuard[ImageSource]:
    """Return whether this is a picture, a file's content or name, and not several of them."""
    kinds = (str, os.PathLike, bytes, bytearray, memoryview, np.ndarray)
    return isinstance(source, kinds) or hasattr(source, "read") or is_pillow(source)


def is_pillow(source: object) -> TypeGuard[PillowImage]:
    """Return whether this is an image of Pillow's, which need not be installed."""
    return any(kind.__module__ == "PIL.Image" for kind in type(source).__mro__)


def _expanded(source: Any, with_videos: bool) -> list[ImageSource]:
    if isinstance(source, str | os.PathLike):
        return list(_files(source, with_videos))
    if hasattr(source, "read"):
        return [content_of(source)]
    return [source]


def _files(path: str | os.PathLike[str], with_videos: bool) -> Iterable[str | os.PathLike[str]]:
    name, named = os.fspath(path), shown(path)
    if os.path.isdir(name):
        listed = (entry for entry in Path(name).iterdir() if not entry.name.startswith("."))
        files = sorted(listed, key=natural_order)
        videos = [entry for entry in files if entry.suffix.lower() in VIDEO_SUFFIXES]
        suffixes = PICTURE_SUFFIXES | VIDEO_SUFFIXES if with_videos else PICTURE_SUFFIXES
        found = [entry for entry in files if entry.suffix.lower() in suffixes]
        if not found:
            hint = f"; name its video itself, as {shown(videos[0])}" if videos else ""
            if not videos and any(entry.is_dir() for entry in files):
                pattern = os.path.join(glob.escape(name), "**", "*.jpg")
                hint = f"; folders in it are not searched: name them, or all as {pattern!r}"
            raise ImageError(f"{named}: the folder contains no picture{hint}")
        return _without_drawn(found, name)
    if glob.has_magic(name) and not os.path.lexists(name):
        names = sorted(glob.glob(name, recursive=True), key=natural_order)
        if not names:
            raise MissingImageError(f"{named}: no file matches", path)
        return _without_drawn([Path(entry) for entry in names], name)
    try:  # before other errors: a video is recognised by its content
        os.stat(name)
    except (FileNotFoundError, NotADirectoryError, ValueError) as error:
        if os.path.islink(name):
            text = f"{named}: a link to {shown(os.readlink(name))}, which does not exist"
            raise MissingImageError(text, path) from error
        if not name:
            raise MissingImageError("the name of a picture is empty", path) from error
        raise MissingImageError(f"{named}: No such file or directory", path) from error
    except OSError as error:
        raise ImageError(f"{named}: {error.strerror or error}") from error
    return [path]


def _without_drawn(found: list[Path], name: str) -> list[Path]:
    """Leave out files that trisquare has drawn on: an overlay beside its photograph."""
    undrawn = [path for path in found if not is_drawn(path)]
    if not undrawn:
        raise ImageError(
            f"{shown(name)}: all its pictures were drawn on by trisquare: name a photograph"
        )
    return undrawn
