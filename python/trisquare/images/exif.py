"""The Exif block of a picture (Exif 2.32), and the focal length that it states."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

TIFF_STARTS = {b"II*\0": "<", b"MM\0*": ">"}
"""First bytes of a TIFF file or an Exif block, and the byte order."""

EXIF_IN_JPEG = b"Exif\0\0"
START_OF_SCAN = 0xDA
START_OF_JPEG = b"\xff\xd8"

EXIF_DIRECTORY, FOCAL_LENGTH, EQUIVALENT = 0x8769, 0x920A, 0xA405
WIDTH, HEIGHT = 0xA002, 0xA003
X_RESOLUTION, Y_RESOLUTION, RESOLUTION_UNIT = 0xA20E, 0xA20F, 0xA210

NUMBERS = {3: "H", 4: "I", 5: "II"}
"""Types of the numbers read here: 16 bits, 32 bits, and fractions of two of these."""

UNITS = {2: 25.4, 3: 10.0, 4: 1.0}
"""Units of resolution in millimetres: inch, centimetre and, beyond the standard, millimetre."""

FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)
"""Diagonal in millimetres of the 35-mm film's picture, to which equivalent focal lengths refer."""


class Entry(NamedTuple):
    """An entry of a directory: tag, type and length, and the position of its value or offset."""

    tag: int
    kind: int
    length: int
    position: int


@dataclass(frozen=True, slots=True)
class ExifBlock:
    """A block in TIFF's format within an encoded picture.

    Attributes
    ----------
    encoded : bytes
        The whole file.
    start : int
        Position of the block in the file.
    order : {"<", ">"}
        Its byte order.
    """

    encoded: bytes
    start: int
    order: str

    @classmethod
    def find(cls, encoded: bytes) -> ExifBlock | None:
        """Find the block of a JPEG, PNG, WebP or TIFF file; None if there is none."""
        start = _exif_start(encoded)
        order = None if start is None else TIFF_STARTS.get(encoded[start : start + 4])
        return None if start is None or order is None else cls(encoded, start, order)

    def entries(self, directory: int | None = None) -> Iterator[Entry]:
        """Yield the entries of a directory, by its offset in the block; of the first one if None.

        The entries end where the file is cut off, or where offsets lead out of it.
        """
        try:
            if directory is None:
                (directory,) = self._unpacked("I", self.start + 4)
            start = self.start + directory
            (count,) = self._unpacked("H", start)
            for position in range(start + 2, start + 2 + 12 * count, 12):
                tag, kind, length = self._unpacked("HHI", position)
                self._unpacked("I", position + 8)  # the entry is complete
                yield Entry(tag, kind, length, position + 8)
        except struct.error:
            return

    def number(self, entry: Entry) -> float | None:
        """Return the only number of an entry; None if it is of another type, or zero."""
        kind = NUMBERS.get(entry.kind)
        if kind is None or entry.length != 1:
            return None
        try:
            position = entry.position
            if kind == "II":  # too long for the entry itself
                position = self.start + self._unpacked("I", position)[0]
            values = self._unpacked(kind, position)
        except struct.error:
            return None
        return values[0] / (values[1:] or (1,))[0] if all(values) else None

    def _unpacked(self, kind: str, position: int) -> tuple[int, ...]:
        return struct.unpack_from(self.order + kind, self.encoded, position)


@dataclass(frozen=True, slots=True)
class StatedFocalLength:
    """Focal length stated by a picture's Exif block.

    Attributes
    ----------
    millimetres : float
        As stated by the lens or the camera.
    pixels_per_millimetre : (float, float)
        Along x and y, on the sensor.
    is_nominal : bool
        Whether these follow from the equivalent for 35-mm film, which is rounded to a millimetre.
    """

    millimetres: float
    pixels_per_millimetre: tuple[float, float]
    is_nominal: bool


def stated_focal_length(encoded: bytes, image_size: tuple[int, int]) -> StatedFocalLength | None:
    """Return the focal length that an encoded picture of this size states.

    None if it does not state the focal length, or the size of a pixel. That is taken from the
    resolution in the focal plane if it refers to a picture of this size, or else from the
    equivalent for 35-mm film, whose diagonal corresponds to that of the picture. Makers and models
    are not looked up.
    """
    block = ExifBlock.find(encoded)
    if block is None:
        return None
    numbers: dict[int, float] = {}
    for entry in block.entries():
        if entry.tag == EXIF_DIRECTORY and (offset := block.number(entry)) is not None:
            for exif_entry in block.entries(int(offset)):
                number = block.number(exif_entry)
                if number is not None:
                    numbers[exif_entry.tag] = number
    millimetres = numbers.get(FOCAL_LENGTH)
    if millimetres is None:
        return None
    resolution = numbers.get(X_RESOLUTION)
    unit = UNITS.get(int(numbers.get(RESOLUTION_UNIT, 2)))
    if resolution is not None and unit and (numbers.get(WIDTH), numbers.get(HEIGHT)) == image_size:
        pixels = resolution / unit, numbers.get(Y_RESOLUTION, resolution) / unit
        return StatedFocalLength(millimetres, pixels, is_nominal=False)
    equivalent = numbers.get(EQUIVALENT)
    if equivalent is None:
        return None
    nominal = math.hypot(*image_size) / FULL_FRAME_DIAGONAL * equivalent / millimetres
    return StatedFocalLength(millimetres, (nominal, nominal), is_nominal=True)


def _exif_start(encoded: bytes) -> int | None:
    """Return the position of the block in TIFF's format."""
    if encoded[:4] in TIFF_STARTS:
        return 0
    if encoded[:2] == START_OF_JPEG:
        return _exif_in_jpeg(encoded)
    if encoded[:4] == b"\x89PNG":
        return _exif_in_png(encoded)
    if encoded[:4] == b"RIFF" and encoded[8:12] == b"WEBP":
        return _exif_in_webp(encoded)
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


def _exif_in_webp(encoded: bytes) -> int | None:
    position = 12
    while position + 8 <= len(encoded):
        if encoded[position : position + 4] == b"EXIF":
            start = position + 8
            is_as_in_jpeg = encoded.startswith(EXIF_IN_JPEG, start)  # some programs write it so
            return start + len(EXIF_IN_JPEG) * is_as_in_jpeg
        length = int.from_bytes(encoded[position + 4 : position + 8], "little")
        position += 8 + length + length % 2
    return None
