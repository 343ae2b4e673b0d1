"""Raw pictures, and other files in TIFF's format, byte by byte."""

import struct

SHORT, LONG, RATIONAL = 3, 4, 10


def directory(entries, at=8):
    """A little-endian TIFF directory of (tag, type, values), followed by its data."""
    sizes = {1: "B", 2: "B", SHORT: "H", LONG: "I", RATIONAL: "i"}
    behind = at + 2 + 12 * len(entries) + 4
    listed, extra = b"", b""
    for tag, kind, values in sorted(entries):
        packed = struct.pack(f"<{len(values)}{sizes[kind]}", *values)
        count = len(values) // (2 if kind == RATIONAL else 1)
        if len(packed) > 4:
            extra += bytes((behind + len(extra)) % 2)
            packed, extra = struct.pack("<I", behind + len(extra)), extra + packed
        listed += struct.pack("<HHI", tag, kind, count) + packed.ljust(4, b"\0")
    return struct.pack("<H", len(entries)) + listed + bytes(4) + extra


def dng(mosaic):
    """A DNG of a grey mosaic, uint16."""
    height, width = mosaic.shape

    def entries(strip):
        identity = [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1]
        return [
            *((254, LONG, [0]), (256, LONG, [width]), (257, LONG, [height])),
            *((258, SHORT, [16]), (259, SHORT, [1]), (262, SHORT, [32803])),
            *((273, LONG, [strip]), (274, SHORT, [8]), (277, SHORT, [1]), (278, LONG, [height])),
            *((279, LONG, [mosaic.nbytes]), (271, 2, b"T\0"), (272, 2, b"T\0")),
            *((33421, SHORT, [2, 2]), (33422, 1, [0, 1, 1, 2]), (50706, 1, [1, 4, 0, 0])),
            *((50708, 2, b"T T\0"), (50714, SHORT, [0]), (50717, LONG, [65535])),
            *((50721, RATIONAL, identity), (50778, SHORT, [21])),
        ]

    start = b"II*\0" + struct.pack("<I", 8)
    length = len(start + directory(entries(0)))
    return start + directory(entries(length)) + mosaic.astype("<u2").tobytes()
