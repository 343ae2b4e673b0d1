"""The mark in pictures that trisquare has drawn on: they are no photographs of a folder."""

from __future__ import annotations

import os
import struct
import zlib

from trisquare._support.writing import PathLike
from trisquare.images.encoding import encode_image
from trisquare.images.pixels import Image

MARK = b"drawn by trisquare"
HEAD = 128
"""Bytes at a file's beginning that hold it."""


def encode_drawn(image: Image, path: PathLike) -> bytes:
    """Encode a picture as `encode_image` does; PNG and JPEG with the mark."""
    encoded = encode_image(image, path)
    if encoded[:4] == b"\x89PNG":
        chunk = b"tEXtSoftware\0" + MARK
        framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return _inserted(encoded, 8 + 12 + _length(encoded, 8, ">I"), framed)
    if encoded[:4] == b"\xff\xd8\xff\xe0":
        comment = b"\xff\xfe" + struct.pack(">H", 2 + len(MARK)) + MARK
        return _inserted(encoded, 4 + _length(encoded, 4, ">H"), comment)
    return encoded


def is_drawn(path: PathLike) -> bool:
    """Whether a file bears the mark; False if it cannot be read, or only once, as a pipe."""
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return MARK in file.read(HEAD)
    except OSError:
        return False


def _length(encoded: bytes, place: int, kind: str) -> int:
    (length,) = struct.unpack_from(kind, encoded, place)
    return int(length)


def _inserted(encoded: bytes, place: int, piece: bytes) -> bytes:
    return encoded[:place] + piece + encoded[place:]
