"""What every camera format consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from trisquare._support.json_members import JsonFields
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.document import Document

ImageSize: TypeAlias = tuple[int, int]

SAY_THE_SIZE = "say it with image_size= (trisquare convert FILE camera.json --size WxH)"
"""What to do about a file without the picture's size: no other command has ``--size``."""

Cameras: TypeAlias = Mapping[str, Callable[[], Lens]]
"""The cameras of a file by name, each read when it is asked for: one may be damaged, or of a
model that nobody knows, beside the one that is wanted."""


@dataclass(frozen=True, slots=True)
class Format:
    """A file format that a camera can be read from and written to.

    Parameters
    ----------
    name : str
        What ``format=`` and ``--from`` call it.
    title : str
        For lists and messages.
    recognises : callable
        Whether a document's text looks like it; raises nothing.
    read : callable
        From a document and the image size that the caller knows, or None, to its cameras. Raises
        ValueError naming the key that is missing or wrong.
    write : callable
        From a lens of one of the families and the extension of the file, with its dot, to text.
    families : tuple of Family
        The models that it can write, the simplest first, the most general last.
    file_names : tuple of str
        Endings of names, in small letters, that files of this format alone have.
    """

    name: str
    title: str
    recognises: Callable[[Document], bool]
    read: Callable[[Document, ImageSize | None], Cameras]
    write: Callable[[Any, str], str]
    families: tuple[Family, ...]
    file_names: tuple[str, ...]


def size_member(members: JsonFields, key: str) -> ImageSize:
    """Return a member that is ``[width, height]``."""
    values = members.integers(key)
    if len(values) != 2:
        raise ValueError(f'"{key}" must be [width, height]')
    return values[0], values[1]


def only(lens: Callable[[], Lens]) -> Cameras:
    """Return the cameras of a file that holds one without a name."""
    return {"camera": lens}
