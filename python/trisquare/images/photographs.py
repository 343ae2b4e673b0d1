"""The photographs of one calibration, one after another."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from trisquare._support.terminal_text import printable
from trisquare._support.threads import Turns
from trisquare.errors import ImageError
from trisquare.images.limits import PictureLimits
from trisquare.images.pixels import Image, ImageSource, VideoFrame, as_recorded, picture_size
from trisquare.images.reading import load_photograph


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """One of the pictures, after its checks.

    Attributes
    ----------
    index : int
    name : str
        Name in messages.
    pixels : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR, rows and columns as they are stored; floats are light.
    remarks : mapping of str to str
        Remarks for the user by a code, each beginning with its name.
    is_repeat : bool
        Whether an earlier picture is the same.
    other_type : str or None
        Type of its pixels as given, if the pictures up to this one are not all of that type.
    path : str or None
        Path of its file, if it was read from one.
    """

    index: int
    name: str
    pixels: Image
    remarks: Mapping[str, str]
    is_repeat: bool
    other_type: str | None
    path: str | None = None


class Photographs:
    """The photographs of one calibration, each loaded once.

    Parameters
    ----------
    sources : sequence of ImageSource
    keep : bool
        Whether they stay in memory, to be drawn on; otherwise every pass loads them again, one at
        a time.
    limits : PictureLimits, optional
        Limits on their files, by default those of the environment.
    """

    def __init__(
        self,
        sources: Sequence[ImageSource],
        *,
        keep: bool = False,
        limits: PictureLimits | None = None,
    ) -> None:
        self.sources = list(sources)
        self._keep = keep
        self._limits = limits
        self._kept: dict[int, Photograph] = {}

    def __len__(self) -> int:
        return len(self.sources)

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names that distinguish several photographs; empty if none comes from a file."""
        names = tuple(_file_name(source) for source in self.sources)
        return names if len(names) > 1 and any(names) else ()

    def __iter__(self) -> Iterator[Photograph]:
        """Yield the photographs in their order.

        Raises
        ------
        ImageError, TypeError, ValueError
            As `loaders`.
        """
        return (load() for load in self.loaders())

    def loaders(self) -> Iterator[Callable[[], Photograph]]:
        """Yield for each photograph a function that loads it and compares it with those before.

        Each may be called once, in any thread. It waits for those before it, which must therefore
        be called before it is.

        Raises
        ------
        ImageError
            When called, if a file cannot be read: a named file is not skipped, and the message
            names it.
        TypeError, ValueError
            When called, if an array is not a picture.
        """
        if len(self._kept) == len(self):
            return (partial(self._kept.__getitem__, index) for index in range(len(self)))
        self._kept.clear()
        earlier = _Earlier(Turns(), {}, set())
        return (partial(self._load, index, earlier) for index in range(len(self)))

    def _load(self, index: int, earlier: _Earlier) -> Photograph:
        photograph = _load(
            index, self.sources[index], self._limits, earlier, is_alone=len(self) == 1
        )
        if self._keep:
            self._kept[index] = photograph
        return photograph


class _Earlier(NamedTuple):
    """Data of the photographs loaded so far, for those after them."""

    turns: Turns
    names: dict[int, str]
    types: set[str]


def _load(
    index: int,
    source: ImageSource,
    limits: PictureLimits | None,
    earlier: _Earlier,
    *,
    is_alone: bool,
) -> Photograph:
    name = _name(index, source)
    key: int | None = None
    try:
        with _naming(name, needed=not is_alone and not _file_name(source)):
            given, tag = load_photograph(source, limits)
            pixels = as_recorded(given)
        # Floats that contain integers count as these, but 16 bits do not count as 8, however dark.
        type_name = (pixels if given.dtype == np.float32 else given).dtype.name
        key = 0 if is_alone else _fingerprint(pixels)
    finally:
        with earlier.turns.turn(index):
            if key is not None:
                twin = earlier.names.setdefault(key, name)
                earlier.types.add(type_name)
                other_type = type_name if len(earlier.types) > 1 else None
    remarks = {}
    if tag is not None:
        ignored = tag.ignored("the result refers", picture_size(pixels))
        remarks["orientation_ignored"] = f"{name}: {ignored}"
    if twin != name:
        remarks["repeated_picture"] = f"{name} is the same picture as {twin}: it is counted once"
    path = os.fspath(source) if isinstance(source, str | os.PathLike) else None
    return Photograph(index, name, pixels, remarks, twin != name, other_type, path)


@contextmanager
def _naming(name: str, *, needed: bool) -> Iterator[None]:
    """Put a picture's name before its error if that is needed to identify it."""
    try:
        yield
    except (TypeError, ValueError, ImageError) as error:
        if needed:
            error.args = (f"{name}: {error}",)
        raise


def _name(index: int, source: ImageSource) -> str:
    file_name = _file_name(source)
    return f"picture {index} ({printable(file_name)})" if file_name else f"picture {index}"


def _file_name(source: ImageSource) -> str:
    """Return the name of a picture's file without its folder; empty if it has none."""
    if isinstance(source, str | os.PathLike):
        return os.path.basename(source)
    if isinstance(source, VideoFrame):
        return f"frame {source.number} of {os.path.basename(source.video)}"
    return ""


def _fingerprint(pixels: Image) -> int:
    """Return a checksum that two photographs hardly ever share (1 pair in 4e9), due to noise."""
    return zlib.crc32(np.ascontiguousarray(pixels).data)
