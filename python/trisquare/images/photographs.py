"""The photographs of one calibration, one after another."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trisquare.images.limits import PictureLimits
from trisquare.images.pixels import Image, ImageSource, picture_size
from trisquare.images.reading import load_picture


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """One of the pictures, checked.

    Attributes
    ----------
    index : int
    name : str
        What messages call it.
    pixels : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR, rows and columns as they are stored.
    remarks : mapping of str to str
        What its user should know of it, each beginning with its name, by a code.
    repeats : bool
        Whether an earlier picture is the same.
    path : str or None
        Of its file, if it was read from one.
    """

    index: int
    name: str
    pixels: Image
    remarks: Mapping[str, str]
    repeats: bool
    path: str | None = None


class Photographs:
    """The photographs of one calibration, each loaded once.

    Parameters
    ----------
    sources : sequence of path or ndarray
    keep : bool
        Whether they stay in memory, to be drawn on; else they can be iterated over once only, and
        are loaded one at a time.
    limits : PictureLimits, optional
        Of their files, by default those of the environment.
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
        self._kept: list[Photograph] = []

    def __len__(self) -> int:
        return len(self.sources)

    def __iter__(self) -> Iterator[Photograph]:
        """Yield the photographs in their order.

        Raises
        ------
        ImageError, TypeError, ValueError
            As `_load_all`.
        """
        if len(self._kept) == len(self.sources):
            yield from self._kept
            return
        self._kept.clear()
        for photograph in _load_all(self.sources, self._limits):
            if self._keep:
                self._kept.append(photograph)
            yield photograph


def _load_all(sources: Sequence[ImageSource], limits: PictureLimits | None) -> Iterator[Photograph]:
    """Load pictures one at a time and compare each with the ones before.

    Raises
    ------
    ImageError
        If a file cannot be read: who named it wants it used, and is told which one it is.
    TypeError, ValueError
        If an array is no picture.
    """
    seen: dict[int, str] = {}
    for index, source in enumerate(sources):
        name = _name(index, source)
        pixels, turn = _loaded(source, limits)
        size = picture_size(pixels)
        remarks = {}
        if turn is not None:
            remarks["orientation_ignored"] = (
                f"{name}: its orientation tag ({turn}) is ignored; the result refers to the "
                f"picture as it is stored, {size[0]} x {size[1]} pixels"
            )
        key = _fingerprint(pixels) if len(sources) > 1 else 0
        twin = seen.setdefault(key, name)
        if twin != name:
            remarks["repeated_picture"] = (
                f"{name} is the same picture as {twin}: it is counted once"
            )
        path = os.fspath(source) if isinstance(source, str | os.PathLike) else None
        yield Photograph(index, name, pixels, remarks, twin != name, path)


def _name(index: int, source: ImageSource) -> str:
    if isinstance(source, str | os.PathLike):
        return f"picture {index} ({os.path.basename(source)})"
    return f"picture {index}"


def _loaded(source: ImageSource, limits: PictureLimits | None) -> tuple[Image, str | None]:
    """Return a picture and how its orientation tag would turn it."""
    if isinstance(source, str | os.PathLike):
        from trisquare.images.reading import read_photograph

        return read_photograph(source, limits)
    return load_picture(source), None


def _fingerprint(pixels: Image) -> int:
    """Return a number that two photographs share only if they are one: noise alone tells them."""
    return zlib.crc32(np.ascontiguousarray(pixels).data)
