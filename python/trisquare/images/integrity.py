"""Check that an encoded picture is complete, which OpenCV does not report."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

JPEG_SIGNATURE = b"\xff\xd8\xff"

# Within JPEG's coded data, 0xFF is a marker unless a zero (stuffing), a restart marker or another
# 0xFF (padding) follows.
JPEG_MARKER = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)


JPEG_END = 0xD9


START_OF_SCAN = 0xDA


def incompleteness(encoded: bytes, max_scans: int) -> str | None:
    """Return the reason why an encoded picture is not decoded; None if there is none.

    It may be incomplete, or a JPEG of more than `max_scans` scans, each of which takes as long to
    decode as a picture.
    """
    if not encoded:
        return "the file is empty"
    if encoded.startswith(PNG_SIGNATURE):
        return _png_incompleteness(encoded)
    return _jpeg_fault(encoded, max_scans) if encoded.startswith(JPEG_SIGNATURE) else None


def _png_incompleteness(encoded: bytes) -> str | None:
    position = len(PNG_SIGNATURE)
    while position + 12 <= len(encoded):
        (length,) = struct.unpack_from(">I", encoded, position)
        end = position + 12 + length
        if end > len(encoded):
            break
        (checksum,) = struct.unpack_from(">I", encoded, end - 4)
        if zlib.crc32(memoryview(encoded)[position + 4 : end - 4]) != checksum:
            return "the PNG is damaged: a checksum is wrong"
        if encoded[position + 4 : position + 8] == b"IEND":
            return None
        position = end
    return "the PNG is truncated: its end chunk is missing"


def jpeg_segments(encoded: bytes) -> Iterator[tuple[int, int]]:
    """Yield the marker of every segment of a JPEG, and the position after it.

    A search for one marker would not suffice: a thumbnail in the header has markers of its own, and
    cameras append data after the last. The segments end where the file is cut off.
    """
    position = 2
    while marker := JPEG_MARKER.search(encoded, position):
        position = marker.end()
        yield marker[1][0], position
        if position + 2 > len(encoded):
            return
        # After a scan's header its coded data follow, which the search skips.
        position += struct.unpack_from(">H", encoded, position)[0]


def _jpeg_fault(encoded: bytes, max_scans: int) -> str | None:
    """Look for the picture's own end marker, and count its scans."""
    scans = 0
    for marker, _ in jpeg_segments(encoded):
        if marker == JPEG_END:
            return None
        scans += marker == START_OF_SCAN
        if scans > max_scans:
            return (
                f"the JPEG has more than the {max_scans} scans that max_scans allows "
                "(TRISQUARE_MAX_SCANS)"
            )
    return "the JPEG is truncated: its end marker is missing"
