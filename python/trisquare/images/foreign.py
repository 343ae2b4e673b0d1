"""Files of cameras that OpenCV does not read: HEIC, raw pictures and video.

HEIC and raw pictures are read with the extras ``trisquare[heif]`` (pillow-heif) and
``trisquare[raw]`` (rawpy). Without them an error says which one is needed, and a raw file's
thumbnail is never taken for the photograph.
"""

from __future__ import annotations

import io
import struct
from pathlib import PurePath

import numpy as np

from trisquare.errors import ImageError
from trisquare.images.boxes import FILE_TYPE
from trisquare.images.exif import TIFF_STARTS
from trisquare.images.limits import PictureLimits
from trisquare.images.orientation import OrientationTag, find_orientation
from trisquare.images.pixels import Image

HEIF, RAW, VIDEO = "heif", "raw", "video"

HEIF_BRANDS = frozenset(
    (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs", b"mif1", b"msf1")
)
AVIF_BRANDS = frozenset((b"avif", b"avis"))
CANON_BRAND = b"crx "
MAX_BRANDS = 32

RAW_STARTS = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FOVb", b"\0MRM")
RAW_SUFFIXES = frozenset((".arw", ".cr2", ".dcr", ".dng", ".kdc", ".nef", ".pef", ".srw", ".3fr"))
"""Extensions of raw files that begin like TIFF."""
DNG_VERSION, SUBFILE_TYPE, SUBDIRECTORIES = 50706, 254, 330
REDUCED_FLAG = 1
"""Bit of the subfile's type: a smaller version of another picture in the file (TIFF 6.0)."""
MAX_ENTRIES = 512

ORIENTATION_OF_FLIP = (1, 2, 4, 3, 5, 8, 6, 7)
"""Orientation tag by LibRaw's flip: 1 mirrors left to right, 2 top to bottom, then 4 exchanges x
and y."""

VIDEO_STARTS = (b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"\0\0\1\xb3", b"OggS", b"FLV\1")
TRANSPORT_PACKET = 188
"""Number of bytes of a packet of MPEG's transport stream; each begins with a G."""


def foreign_kind(encoded: bytes, name: str = "") -> str | None:
    """Return ``"heif"``, ``"raw"`` or ``"video"`` by a file's content; None for all else.

    If a raw file begins like TIFF, its name may decide.
    """
    if encoded[4:8] == FILE_TYPE:
        (length,) = struct.unpack_from(">I", encoded)
        brands = encoded[8 : min(length, 8 + 4 * MAX_BRANDS)]
        brand_set = {brands[start : start + 4] for start in range(0, len(brands), 4)}
        if brand_set & AVIF_BRANDS:
            return None
        if brand_set & HEIF_BRANDS:
            return HEIF
        return RAW if CANON_BRAND in brand_set else VIDEO
    if encoded.startswith(RAW_STARTS):
        return RAW
    if encoded[:4] in TIFF_STARTS:
        is_named_raw = PurePath(name).suffix.lower() in RAW_SUFFIXES
        return RAW if is_named_raw or encoded[8:10] == b"CR" or _is_raw_tiff(encoded) else None
    is_avi = encoded[:4] == b"RIFF" and encoded[8:12] == b"AVI "
    is_stream = encoded[: 3 * TRANSPORT_PACKET : TRANSPORT_PACKET] == b"GGG"
    return VIDEO if is_avi or is_stream or encoded.startswith(VIDEO_STARTS) else None


def _is_raw_tiff(encoded: bytes) -> bool:
    """Return whether the first directory is a DNG's, or a thumbnail beside its original."""
    order = TIFF_STARTS[encoded[:4]]
    values = {}
    try:
        (directory,) = struct.unpack_from(f"{order}I", encoded, 4)
        (count,) = struct.unpack_from(f"{order}H", encoded, directory)
        for index in range(min(count, MAX_ENTRIES)):
            position = directory + 2 + 12 * index
            tag, _, _, value = struct.unpack_from(f"{order}HHII", encoded, position)
            values[tag] = value
    except struct.error:
        pass  # cut off: the values read so far are used
    is_reduced = values.get(SUBFILE_TYPE, 0) & REDUCED_FLAG and SUBDIRECTORIES in values
    return DNG_VERSION in values or bool(is_reduced)


def read_foreign(
    kind: str, encoded: bytes, name: str, limits: PictureLimits
) -> tuple[Image, OrientationTag | None]:
    """Decode a file of a foreign kind, with rows and columns as stored.

    The values of a raw picture are linear, of 16 bits.

    Raises
    ------
    ImageError
        If it is a video, the extra is not installed, or the file is damaged or too large.
    """
    if kind == VIDEO:
        raise ImageError(
            f"{name}: a video, not a photograph: calibrate and batch choose frames of it with "
            "--frames 10 (frames=10); for other commands, extract frames of it, for example with "
            "ffmpeg -i VIDEO -vf fps=1 frame-%03d.png"
        )
    return _read_heif(encoded, name, limits) if kind == HEIF else _read_raw(encoded, name, limits)


def _read_heif(
    encoded: bytes, name: str, limits: PictureLimits
) -> tuple[Image, OrientationTag | None]:
    try:
        import pillow_heif
    except ImportError as error:
        raise ImageError(
            f"{name}: a HEIC picture, which needs pip install 'trisquare[heif]'; or convert it to "
            "JPEG or PNG in its full size"
        ) from error
    try:
        picture = pillow_heif.open_heif(
            io.BytesIO(encoded), convert_hdr_to_8bit=False, bgr_mode=True
        )
        limits.check_pixels(name, picture.size)
        pixels = np.asarray(picture)
    except (ImageError, MemoryError):
        raise
    except Exception as error:  # its parser raises any on damage: IndexError, SyntaxError
        raise ImageError(f"{name}: not a readable HEIC picture") from error
    shown = pixels if pixels.ndim == 2 else pixels[:, :, :3]
    tag = find_orientation(encoded)  # pillow-heif has applied it
    return (shown, None) if tag is None else (tag.undone(shown), tag)


def _read_raw(
    encoded: bytes, name: str, limits: PictureLimits
) -> tuple[Image, OrientationTag | None]:
    try:
        import rawpy
    except ImportError as error:
        raise ImageError(
            f"{name}: a raw picture, which needs pip install 'trisquare[raw]'; or develop it into "
            "a PNG or a TIFF, without corrections of the lens"
        ) from error
    try:
        with rawpy.imread(io.BytesIO(encoded)) as picture:
            limits.check_pixels(name, (picture.sizes.raw_width, picture.sizes.raw_height))
            tag = OrientationTag.of(ORIENTATION_OF_FLIP[picture.sizes.flip & 7])
            pixels = picture.postprocess(
                gamma=(1, 1),
                no_auto_bright=True,
                use_camera_wb=True,
                output_bps=16,
                user_flip=0,
                output_color=rawpy.ColorSpace.raw,
            )
    except (rawpy.LibRawError, rawpy.NotSupportedError) as error:
        raise ImageError(f"{name}: not a readable raw picture") from error
    return np.asarray(pixels[:, :, ::-1]), tag
