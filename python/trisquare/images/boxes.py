"""Orientation of the picture in a HEIC or AVIF file, from its boxes (ISO 23008-12)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

FILE_TYPE = b"ftyp"
"""Type of the first box of ISO 14496-12: after its length, before the brands."""

MAX_BOXES, MAX_ITEMS = 1024, 65535
"""Maximum numbers of boxes and of items, more than any camera writes: a hostile file must not take
long."""

FULL_BOX = 4
"""Number of bytes of the version and the flags before a full box's content."""


def stated_turn(encoded: bytes) -> tuple[bool, int]:
    """Return the mirroring and turn of the picture in a HEIC or AVIF file before it is shown.

    The boxes ``irot`` and ``imir`` of its primary item state them, in their order; an Exif block
    there states nothing that programs may apply.

    Returns
    -------
    bool
        Whether it is mirrored left to right.
    int
        Quarter turns clockwise, 0 to 3, that follow. The picture of a damaged file is neither
        mirrored nor turned.
    """
    is_mirrored, quarters = False, 0
    try:
        for kind, value in _turns(encoded):
            if kind == b"irot":  # anticlockwise
                quarters -= value & 3
            else:  # axis 1 exchanges left and right; axis 0 does that and half a turn
                is_mirrored, quarters = not is_mirrored, (0 if value & 1 else 2) - quarters
    except (struct.error, LookupError):
        return False, 0
    return is_mirrored, quarters % 4


def _turns(encoded: bytes) -> Iterator[tuple[bytes, int]]:
    """Yield kind and value of the boxes that turn the primary item."""
    start, end = _places(encoded, 0, len(encoded))[b"meta"]
    meta = _places(encoded, start + FULL_BOX, end)
    start, _ = meta[b"pitm"]
    (primary,) = struct.unpack_from(">I" if encoded[start] else ">H", encoded, start + FULL_BOX)
    properties = _places(encoded, *meta[b"iprp"])
    stated = list(_boxes(encoded, *properties[b"ipco"]))
    for index in _associations(encoded, properties[b"ipma"][0], primary):
        if index == 0:  # no property
            continue
        kind, start, _ = stated[index - 1]
        if kind in (b"irot", b"imir"):
            yield kind, encoded[start]


def _places(encoded: bytes, start: int, end: int) -> dict[bytes, tuple[int, int]]:
    """Return where the content of each kind of box begins and ends."""
    return {kind: (begin, last) for kind, begin, last in _boxes(encoded, start, end)}


def _boxes(encoded: bytes, position: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield the kind of each box between two places, and where its content begins and ends."""
    for _ in range(MAX_BOXES):
        if position + 8 > end:
            return
        length, kind = struct.unpack_from(">I4s", encoded, position)
        content = position + 8
        if length == 1:
            (length,) = struct.unpack_from(">Q", encoded, content)
            content += 8
        last = position + length if length else end
        if not content <= last <= end:
            return
        yield kind, content, last
        position = last


def _associations(encoded: bytes, position: int, item: int) -> Iterator[int]:
    """Yield the properties of an item, counted from 1, from the content of an ``ipma`` box."""
    version, is_wide = encoded[position], encoded[position + 3] & 1
    (count,) = struct.unpack_from(">I", encoded, position + FULL_BOX)
    position += FULL_BOX + 4
    for _ in range(min(count, MAX_ITEMS)):
        (name,) = struct.unpack_from(">I" if version else ">H", encoded, position)
        position += 4 if version else 2
        kind, mask = ("H", 0x7FFF) if is_wide else ("B", 0x7F)  # the first bit is a flag: essential
        indices = struct.unpack_from(f">{encoded[position]}{kind}", encoded, position + 1)
        position += 1 + struct.calcsize(f">{len(indices)}{kind}")
        if name == item:
            yield from (index & mask for index in indices)
