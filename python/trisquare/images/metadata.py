"""Metadata in the header of encoded pictures."""

from __future__ import annotations

import struct
import zlib

from trisquare.images.exif import START_OF_JPEG

START_OF_PNG = b"\x89PNG"


def with_metadata(
    encoded: bytes, segment: tuple[bytes, bytes], chunk: tuple[bytes, bytes]
) -> bytes | None:
    """Return a JPEG with a segment, or a PNG with a chunk, in its header; None for other formats.

    Parameters
    ----------
    encoded : bytes
        As OpenCV encodes it.
    segment, chunk : tuple of bytes
        Marker or type, and the content.
    """
    if encoded[:2] == START_OF_JPEG:
        marker, content = segment
        length = struct.pack(">H", len(content) + 2)
        return START_OF_JPEG + marker + length + content + encoded[2:]
    if encoded[:4] == START_OF_PNG:
        kind, content = chunk
        checksum = struct.pack(">I", zlib.crc32(kind + content))
        framed = struct.pack(">I", len(content)) + kind + content + checksum
        (length_of_header,) = struct.unpack_from(">I", encoded, 8)
        after_header = 8 + 12 + length_of_header
        return encoded[:after_header] + framed + encoded[after_header:]
    return None
