"""The orientation that cameras write into photographs (Exif 2.32, section 4.6.4)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from trisquare.images.boxes import FILE_TYPE, stated_turn
from trisquare.images.exif import EXIF_IN_JPEG, ExifBlock
from trisquare.images.metadata import with_metadata
from trisquare.images.pixels import Image

UPRIGHT = 1

ORIENTATION = 0x0112
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
"""Effect of the tag on the stored picture in programs that apply it before they show it."""

STEPS = {
    **{2: (True, 0), 3: (False, 2), 4: (True, 2)},
    **{5: (True, 3), 6: (False, 1), 7: (True, 1), 8: (False, 3)},
}
"""The same as whether the picture is mirrored left to right, and the number of quarter turns
clockwise that follow."""


@dataclass(frozen=True, slots=True)
class OrientationTag:
    """An orientation tag that would turn its picture.

    Attributes
    ----------
    value : int
        2 to 8.
    """

    value: int

    @classmethod
    def of(cls, value: object) -> OrientationTag | None:
        """Return the tag of this value; None if it turns nothing."""
        return next((cls(known) for known in TURNS if known == value), None)

    @classmethod
    def of_steps(cls, is_mirrored: bool, quarters: int) -> OrientationTag | None:
        """Return the tag that mirrors left to right and then turns clockwise; None for neither."""
        return next(
            (cls(value) for value in STEPS if STEPS[value] == (is_mirrored, quarters)), None
        )

    @property
    def turn(self) -> str:
        """Effect on the picture in programs that apply the tag."""
        return TURNS[self.value]

    def ignored(self, what_refers: str, size: tuple[int, int]) -> str:
        """Return a text: the tag is ignored, and `what_refers` to the stored picture."""
        return (
            f"its orientation tag ({self.turn}) is ignored; {what_refers} to the picture as it is "
            f"stored, {size[0]} x {size[1]} pixels"
        )

    def undone(self, shown: Image) -> Image:
        """Return a picture that is turned by the tag to its stored orientation."""
        is_mirrored, quarters = STEPS[self.value]
        turned = np.rot90(shown, quarters)
        return np.ascontiguousarray(turned[:, ::-1] if is_mirrored else turned)


def with_orientation(encoded: bytes, value: int) -> bytes | None:
    """Return an encoded JPEG or PNG with an orientation tag added; None for other formats.

    Parameters
    ----------
    encoded : bytes
        As OpenCV encodes it, without any tag.
    value : int
        1 to 8.
    """
    entry = struct.pack(">HHIHH", ORIENTATION, SHORT, 1, value, 0)
    block = b"MM\0*" + struct.pack(">IH", 8, 1) + entry + bytes(4)
    return with_metadata(encoded, (b"\xff\xe1", EXIF_IN_JPEG + block), (b"eXIf", block))


def find_orientation(encoded: bytes) -> OrientationTag | None:
    """Find the orientation tag of a JPEG, PNG, WebP or TIFF file; None if it would turn nothing.

    For a HEIC or AVIF file, the tag is the equivalent of its boxes.
    """
    if encoded[4:8] == FILE_TYPE:
        return OrientationTag.of_steps(*stated_turn(encoded))
    place = _tag_place(encoded)
    if place is None:
        return None
    return OrientationTag.of(*struct.unpack_from(place[0], encoded, place[1]))


def made_upright(encoded: bytes) -> bytes:
    """Return a copy of such a file whose orientation tag, if any, is upright."""
    copy, place = bytearray(encoded), _tag_place(encoded)
    if place is not None:
        struct.pack_into(place[0], copy, place[1], UPRIGHT)
    return bytes(copy)


def _tag_place(encoded: bytes) -> tuple[str, int] | None:
    """Return the format and the position of the tag's number in a file."""
    block = ExifBlock.find(encoded)
    if block is not None:
        for tag, kind, length, position in block.entries():
            if (tag, kind, length) == (ORIENTATION, SHORT, 1):
                return f"{block.order}H", position
    return None
