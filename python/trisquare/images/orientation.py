"""The orientation tag that cameras write into photographs (Exif 2.32, section 4.6.4)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

UPRIGHT = 1

TAG = 0x0112
SHORT = 3
"""The tag's type: 16 bits."""

TURNS = {
    2: "mirrored left to right",
    3: "turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "turned by 90 degrees and mirrored",
    6: "turned clockwise by 90 degrees",
    7: "turned by 90 degrees and mirrored",
    8: "turned anticlockwise by 90 degrees",
}
"""What a program that applies the tag does to the stored picture before it shows it."""

TIFF_STARTS = {b"II*\0": "<", b"MM\0*": ">"}
"""How a TIFF file or an Exif block begins, and its byte order."""

EXIF_IN_JPEG = b"Exif\0\0"
START_OF_SCAN = 0xDA
START_OF_JPEG = b"\xff\xd8"


@dataclass(frozen=True, slots=True)
class OrientationTag:
    """An orientation tag within an encoded picture.

    Attributes
    ----------
    value : int
        1 to 8; anything else counts as 1.
    position : int
        Where in the file its two bytes are.
    order : {"<", ">"}
        Their byte order.
    """

    value: int
    position: int
    order: str

    @property
    def turn(self) -> str | None:
        """What programs that apply the tag do to the picture; None if nothing."""
        return TURNS.get(self.value)

    def made_upright(self, encoded: bytes) -> bytes:
        """Return a copy of the file that says that its picture is upright."""
        copy = bytearray(encoded)
        struct.pack_into(f"{self.order}H", copy, self.position, UPRIGHT)
        return bytes(copy)


def with_orientation(encoded: bytes, value: int) -> bytes | None:
    """Return an encoded picture with an orientation tag; None if it is no JPEG or PNG without one.

    Parameters
    ----------
    encoded : bytes
        As OpenCV encodes it, that is without any tag.
    value : int
        1 to 8.
    """
    entry = struct.pack(">HHIHH", TAG, SHORT, 1, value, 0)
    block = b"MM\0*" + struct.pack(">IH", 8, 1) + entry + bytes(4)
    if encoded[:2] == START_OF_JPEG:
        content = EXIF_IN_JPEG + block
        segment = b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content
        return START_OF_JPEG + segment + encoded[2:]
    if encoded[:4] == b"\x89PNG":
        (length,) = struct.unpack_from(">I", encoded, 8)
        after_header = 8 + 12 + length
        chunk = struct.pack(">I", len(block)) + b"eXIf" + block
        checked = chunk + struct.pack(">I", zlib.crc32(chunk[4:]))
        return encoded[:after_header] + checked + encoded[after_header:]
    return None


def find_orientation(encoded: bytes) -> OrientationTag | None:
    """Find the orientation tag of a JPEG, PNG or TIFF file; None if there is none."""
    start = _exif_start(encoded)
    return None if start is None else _tag_at(encoded, start)


def _exif_start(encoded: bytes) -> int | None:
    """Where the block in TIFF's format begins that the tag is in."""
    if encoded[:4] in TIFF_STARTS:
        return 0
    if encoded[:2] == START_OF_JPEG:
        return _exif_in_jpeg(encoded)
    if encoded[:4] == b"\x89PNG":
        return _exif_in_png(encoded)
    return None


def _exif_in_jpeg(encoded: bytes) -> int | None:
    """Walk the segments before the coded data."""
    position = 2
    while position + 4 <= len(encoded) and encoded[position] == 0xFF:
        if encoded[position + 1] == START_OF_SCAN:
            return None
        if encoded[position + 4 : position + 10] == EXIF_IN_JPEG:
            return position + 10
        position += 2 + int.from_bytes(encoded[position + 2 : position + 4], "big")
    return None


def _exif_in_png(encoded: bytes) -> int | None:
    position = 8
    while position + 12 <= len(encoded):
        if encoded[position + 4 : position + 8] == b"eXIf":
            return position + 8
        position += 12 + int.from_bytes(encoded[position : position + 4], "big")
    return None


def _tag_at(encoded: bytes, start: int) -> OrientationTag | None:
    """Look through the first directory of a block in TIFF's format."""
    order = TIFF_STARTS.get(encoded[start : start + 4])
    if order is None:
        return None
    try:
        (offset,) = struct.unpack_from(f"{order}I", encoded, start + 4)
        directory = start + offset
        (count,) = struct.unpack_from(f"{order}H", encoded, directory)
        for entry in range(directory + 2, directory + 2 + 12 * count, 12):
            tag, kind, length, value = struct.unpack_from(f"{order}HHIH", encoded, entry)
            if (tag, kind, length) == (TAG, SHORT, 1):
                return OrientationTag(value, entry + 8, order)
    except struct.error:
        return None  # cut off, or offsets that lead out of the file
    return None
