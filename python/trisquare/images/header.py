"""The size in a picture's header, read before anything is decoded."""

from __future__ import annotations

import io
import struct

from trisquare.images.exif import ExifBlock
from trisquare.images.integrity import JPEG_SIGNATURE, PNG_SIGNATURE, jpeg_segments

LARGEST_STATED = 2**32 - 1
"""Maximum of 32 bits; Netpbm has numbers of any length."""

TIFF_WIDTH, TIFF_HEIGHT = 256, 257

STARTS_OF_FRAME = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
"""Markers of JPEG segments that state a size."""


def stated_size(encoded: bytes) -> tuple[int, int] | None:
    """Return width and height from the header of an encoded picture.

    Parameters
    ----------
    encoded : bytes
        A file's content: JPEG, PNG, TIFF, WebP, BMP, GIF, JPEG 2000, AVIF or Netpbm.

    Returns
    -------
    (int, int) or None
        In pixels, as stored; None for other formats and for damaged headers, left to OpenCV.
    """
    if encoded[:1].isspace() or encoded.startswith((b"<", b"\xef\xbb\xbf")):
        return None  # text, such as SVG: not a picture here, and not parsed
    try:
        width, height = _usual_size(encoded) or _other_size(encoded)
    except Exception:  # a damaged header may raise any error
        return None
    is_possible = min(width, height) > 0 and max(width, height) <= LARGEST_STATED
    return (int(width), int(height)) if is_possible else None


def _usual_size(encoded: bytes) -> tuple[int, int] | None:
    """Return the size of a PNG, JPEG or TIFF; None if its header is not as usual."""
    if encoded.startswith(PNG_SIGNATURE) and encoded[12:16] == b"IHDR":
        return struct.unpack_from(">II", encoded, 16)
    if encoded.startswith(JPEG_SIGNATURE):
        return _jpeg_size(encoded)
    block = ExifBlock.find(encoded)
    if block is None or block.start > 0:
        return None
    width, height = (
        next((block.number(entry) for entry in block.entries() if entry.tag == tag), None)
        for tag in (TIFF_WIDTH, TIFF_HEIGHT)
    )
    return None if width is None or height is None else (int(width), int(height))


def _jpeg_size(encoded: bytes) -> tuple[int, int] | None:
    for marker, position in jpeg_segments(encoded):
        if marker in STARTS_OF_FRAME:
            height, width = struct.unpack_from(">HH", encoded, position + 3)
            return (width, height) if width and height else None
    return None


def _other_size(encoded: bytes) -> tuple[int, int]:
    import imagesize  # it loads code for requests to servers, 4 MB

    width, height = imagesize.get(io.BytesIO(encoded), exif_rotation=False)
    return int(width), int(height)
