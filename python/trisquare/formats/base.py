"""Parts of every camera format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from trisquare._support.json_members import JsonFields
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.document import Document

ImageSize: TypeAlias = tuple[int, int]

SAY_THE_SIZE = "state it with image_size= (trisquare convert FILE camera.json --size WxH)"
"""Advice about a file without the picture's size: no other command has ``--size``."""

Cameras: TypeAlias = Mapping[str, Callable[[], Lens]]
"""Cameras of a file by name, each read on demand: others of the file may be damaged, or of an
unknown model."""


@dataclass(frozen=True, slots=True)
class Format:
    """A file format that a camera can be read from and written to.

    Parameters
    ----------
    name : str
        Name of the format for ``format=`` and ``--from``.
    title : str
        Title in lists and messages.
    recognises : callable
        Whether a document looks like this format; raises nothing.
    read : callable
        Returns the cameras of a document, given the image size that the caller knows, or None.
        Raises ValueError naming the key that is missing or wrong.
    write : callable
        Returns the text for a lens of one of the families, given the file's extension, with its
        dot.
    families : tuple of Family
        The models that it can write, the simplest first, the most general last.
    file_names : tuple of str
        Endings of file names, in small letters, that imply this format.
    """

    name: str
    title: str
    recognises: Callable[[Document], bool]
    read: Callable[[Document, ImageSize | None], Cameras]
    write: Callable[[Any, str], str]
    families: tuple[Family, ...]
    file_names: tuple[str, ...]


def size_member(members: JsonFields, key: str) -> ImageSize:
    """Return the value of a member of the form ``[width, height]``."""
    values = members.integers(key)
    if len(values) != 2:
        raise ValueError(f'"{key}" must be [width, height]')
    return values[0], values[1]


def only(lens: Callable[[], Lens]) -> Cameras:
    """Return the cameras of a file with one camera that has no name."""
    return {"camera": lens}
