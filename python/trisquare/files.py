"""Reading photographs whole, and writing files whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from trisquare.errors import ImageError
from trisquare.named_file import read_bytes
from trisquare.orientation import TIFF_STARTS, find_orientation
from trisquare.pictures import PIXEL_TYPES, Image

PathLike: TypeAlias = str | os.PathLike[str]

# Grey stays grey and 16 bits stay 16. The orientation tag is not obeyed: the camera matrix
# belongs to the picture as the sensor delivered it. (For TIFF, OpenCV obeys it all the same.)
READ_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
# Within JPEG's coded data, 0xFF is a marker unless a zero (stuffing), a restart marker or another
# 0xFF (padding) follows.
JPEG_MARKER = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)
JPEG_END = 0xD9


def read_image(path: PathLike) -> Image:
    """Read a photograph as it was recorded, refusing files that are not whole.

    Parameters
    ----------
    path : str or path
        Any format that OpenCV reads: PNG and TIFF of 8 and 16 bits, TIFF of 32-bit floats, JPEG
        (progressive and CMYK too), palettes and two levels. An orientation tag is ignored: the
        result belongs to the sensor's picture, rows and columns as they are stored.

    Returns
    -------
    ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR; an alpha channel is dropped.

    Raises
    ------
    ImageError
        If the file is missing, is no picture, or is truncated (OpenCV alone may return a
        truncated picture with its lower part grey); if its pixels are signed, of 32-bit integers
        or of 64-bit floats, or NaN.
    """
    return read_photograph(path)[0]


def read_photograph(path: PathLike) -> tuple[Image, str | None]:
    """Read a photograph as `read_image` does, and say how its orientation tag would turn it.

    The text completes "its orientation tag says that it is to be shown"; it is None where there
    is no tag, or an upright picture's.
    """
    try:
        encoded = read_bytes(path)
    except OSError as error:
        raise ImageError(str(error)) from error
    reason = _incompleteness(encoded)
    if reason:
        raise ImageError(f"{os.fspath(path)}: {reason}")
    tag = find_orientation(encoded)
    turn = None if tag is None else tag.turn
    if tag is not None and turn is not None and encoded[:4] in TIFF_STARTS:
        encoded = tag.made_upright(encoded)
    try:
        image = cv2.imdecode(np.frombuffer(encoded, np.uint8), READ_FLAGS)
    except cv2.error as error:
        raise ImageError(f"{os.fspath(path)}: not a readable picture") from error
    if image is None:
        raise ImageError(f"{os.fspath(path)}: not a readable picture")
    if image.dtype not in PIXEL_TYPES:
        raise ImageError(f"{os.fspath(path)}: pixels of type {image.dtype} are not supported")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        raise ImageError(f"{os.fspath(path)}: some pixels are NaN or infinite")
    return image, turn


def _incompleteness(encoded: bytes) -> str | None:
    """Say why an encoded picture cannot be whole; None if nothing speaks against it."""
    if not encoded:
        return "the file is empty"
    if encoded.startswith(PNG_SIGNATURE):
        return _png_incompleteness(encoded)
    if encoded.startswith(JPEG_SIGNATURE) and not _jpeg_ends(encoded):
        return "the JPEG is truncated: its end marker is missing"
    return None


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


def _jpeg_ends(encoded: bytes) -> bool:
    """Walk the segments to the picture's own end marker.

    Searching for the marker would not do: a thumbnail in the header has one of its own, and
    cameras append data after the last.
    """
    position = 2
    while marker := JPEG_MARKER.search(encoded, position):
        kind = marker[1][0]
        position = marker.end()
        if kind == JPEG_END:
            return True
        if position + 2 > len(encoded):
            return False
        # After a scan's header follows its coded data, which the search passes over.
        position += struct.unpack_from(">H", encoded, position)[0]
    return False


def check_picture_name(path: PathLike) -> None:
    """Raise ValueError if no picture format has the path's extension."""
    suffix = Path(path).suffix
    # The extension alone: a name that is no UTF-8 crashes OpenCV.
    if not (suffix.isascii() and cv2.haveImageWriter(f"picture{suffix}")):
        raise ValueError(f"{os.fspath(path)}: no picture format has the extension {suffix!r}")


def encode_image(image: Image, path: PathLike) -> bytes:
    """Encode a picture in the format that the path's extension names.

    Raises
    ------
    ValueError
        If it names none.
    """
    check_picture_name(path)
    encoded = cv2.imencode(Path(path).suffix, image)[1]
    return encoded.tobytes()


@contextmanager
def writing(path: PathLike) -> Iterator[None]:
    """Let an OSError of the system about an output begin with the name that the user gave."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise  # said already
        said = f"{os.fspath(path)}: cannot be written: {error.strerror}"
        raise type(error)(said) from error


def check_writable(path: PathLike) -> None:
    """Raise OSError if `write_atomically` could not write to this path.

    So that a long calibration does not run for an answer that cannot be kept.
    """
    target = Path(os.path.realpath(path))
    with writing(path):
        if not target.parent.is_dir():
            raise FileNotFoundError(f"{os.fspath(path)}: there is no folder {target.parent}")
        if target.exists() and not target.is_file():
            raise OSError(f"{os.fspath(path)}: is not a file")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise PermissionError(f"{os.fspath(path)}: the folder {target.parent} is not writable")


def write_atomically(contents: Mapping[PathLike, bytes]) -> None:
    """Write files so that each is either complete or untouched.

    Every content goes to a temporary file beside its target first; only when all of them are on
    the disk does the first one take its place.

    Parameters
    ----------
    contents : mapping of path to bytes
        What to write where. A symbolic link is followed, an existing file keeps its mode.

    Raises
    ------
    OSError
        If a file cannot be written; no target was touched then.
    """
    write_in_turn(contents.items())


def write_in_turn(contents: Iterable[tuple[PathLike, bytes]]) -> None:
    """Write files as `write_atomically` does, each content made when its turn has come.

    So that many pictures are never in memory at once; an error while one is made touches no
    target either.
    """
    staged: list[tuple[PathLike, Path, Path]] = []
    try:
        for path, content in contents:
            check_writable(path)
            target = Path(os.path.realpath(path))
            temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
            # Opened, not made by tempfile: the file shall have the mode that the umask gives.
            with writing(path), temporary.open("xb") as file:
                staged.append((path, temporary, target))
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if target.exists():
                shutil.copymode(target, temporary)
        for path, temporary, target in staged:
            with writing(path):
                temporary.replace(target)
    finally:
        for _, temporary, _ in staged:
            temporary.unlink(missing_ok=True)
