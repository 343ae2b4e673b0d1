"""The mark in pictures that trisquare has drawn on, which are not taken for photographs."""

from __future__ import annotations

import os

from trisquare._support.writing import PathLike
from trisquare.images.encoding import encode_image
from trisquare.images.metadata import with_metadata
from trisquare.images.pixels import Image

MARK = b"drawn by trisquare"
MARKED_BYTES = 128
"""Number of bytes at a file's beginning that contain the mark."""


def encode_drawn(image: Image, path: PathLike) -> bytes:
    """Encode a picture as `encode_image` does; PNG and JPEG with the mark."""
    encoded = encode_image(image, path)
    marked = with_metadata(encoded, (b"\xff\xfe", MARK), (b"tEXt", b"Software\0" + MARK))
    return encoded if marked is None else marked


def is_drawn(path: PathLike) -> bool:
    """Return whether a file has the mark; False if it cannot be read, or only once, as a pipe."""
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return MARK in file.read(MARKED_BYTES)
    except OSError:
        return False
