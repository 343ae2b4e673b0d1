"""The orientation tag that cameras write into photographs (Exif 2.32, section 4.6.4)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from trisquare.images.exif import EXIF_IN_JPEG, START_OF_JPEG, ExifBlock

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

    def ignored(self, what_refers: str, size: tuple[int, int]) -> str:
        """Say that the tag is ignored, and what therefore refers to the stored picture."""
        return (
            f"its orientation tag ({self.turn}) is ignored; {what_refers} to the picture as it is "
            f"stored, {size[0]} x {size[1]} pixels"
        )

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
    block = ExifBlock.find(encoded)
    if block is None:
        return None
    for tag, kind, length, position in block.entries():
        if (tag, kind, length) == (TAG, SHORT, 1):
            (value,) = struct.unpack_from(f"{block.order}H", encoded, position)
            return OrientationTag(value, position, block.order)
    return None
