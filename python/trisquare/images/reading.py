"""Reading of photographs, which must be complete."""

from __future__ import annotations

import os

import numpy as np

from trisquare._support.paths import read_bytes, shown
from trisquare._support.writing import PathLike
from trisquare.errors import ImageError, MissingImageError, lacks_memory
from trisquare.images.exif import TIFF_STARTS
from trisquare.images.foreign import foreign_kind, read_foreign
from trisquare.images.header import stated_size
from trisquare.images.integrity import incompleteness
from trisquare.images.limits import PictureLimits
from trisquare.images.orientation import (
    ORIENTATION,
    OrientationTag,
    find_orientation,
    made_upright,
)
from trisquare.images.pixels import PIXEL_TYPES, Image, ImageSource, PillowImage, VideoFrame
from trisquare.images.sources import content_of, is_pillow

SHAPES = ((), (1,), (3,), (4,))
"""Possible shapes of a pixel."""


def read_image(path: ImageSource) -> Image:
    """Read a photograph as it was recorded, refusing incomplete files.

    Parameters
    ----------
    path : str, path, bytes, binary file or PIL.Image.Image
        A file, or its content, in any format that OpenCV reads: PNG and TIFF of 8 and 16 bits,
        TIFF of 32-bit floats, JPEG (progressive and CMYK too), palettes and two levels; with
        ``trisquare[heif]`` HEIC, with ``trisquare[raw]`` raw pictures. An orientation tag is
        ignored, and so are the boxes that turn a HEIC picture: the result is the sensor's picture,
        rows and columns as they are stored.

    Returns
    -------
    ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR; an alpha channel is dropped.

    Raises
    ------
    ImageError
        If the file is missing (`MissingImageError`), not a picture, or truncated (OpenCV alone
        may return a truncated picture with its lower part grey); if its pixels are signed, of
        32-bit integers or of 64-bit floats, or NaN.

    Examples
    --------
    A camera applies to this picture, while ``cv2.imread(path)`` turns a phone's:

    >>> picture = ts.read_image("photo.jpg")
    >>> picture.shape[1::-1] == result.camera.image_size
    True
    """
    return load_picture(path)


def read_photograph(
    path: PathLike, limits: PictureLimits | None = None
) -> tuple[Image, OrientationTag | None]:
    """Read a photograph as `read_image` does, with its orientation tag if that would turn it.

    `limits` are by default those of the environment.
    """
    limits = PictureLimits.stated() if limits is None else limits
    try:
        encoded = _limited_bytes(path, limits)
    except FileNotFoundError as error:
        raise MissingImageError(str(error), path) from error
    except OSError as error:
        raise ImageError(str(error)) from error
    return decode_photograph(encoded, shown(path), limits)


def decode_photograph(
    encoded: bytes, name: str, limits: PictureLimits
) -> tuple[Image, OrientationTag | None]:
    """Decode a file's content as `read_photograph` does; errors begin with the name."""
    limits.check_bytes(name, len(encoded))
    kind = foreign_kind(encoded, name)
    if kind is not None:
        return read_foreign(kind, encoded, name, limits)
    limits.check_pixels(name, stated_size(encoded) or (0, 0))
    reason = incompleteness(encoded, limits.max_scans)
    if reason:
        raise ImageError(f"{name}: {reason}")
    tag = find_orientation(encoded)
    if tag is not None and encoded[:4] in TIFF_STARTS:
        encoded = made_upright(encoded)
    import cv2  # loaded where a file is read

    # Grey and 16 bits are kept. The orientation tag is ignored: the camera matrix belongs to the
    # picture as the sensor delivered it. (For TIFF, OpenCV applies the tag nevertheless.)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(encoded, np.uint8), flags)
    except cv2.error as error:
        if lacks_memory(error):
            raise MemoryError(f"{name} cannot be decoded") from error
        raise ImageError(f"{name}: not a readable picture") from error
    if image is None:
        raise ImageError(f"{name}: not a readable picture")
    if image.dtype not in PIXEL_TYPES:
        raise ImageError(f"{name}: pixels of type {image.dtype} are not supported")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        raise ImageError(f"{name}: some pixels are NaN or infinite")
    return image, tag


def _limited_bytes(path: PathLike, limits: PictureLimits) -> bytes:
    try:
        size = os.stat(path).st_size
    except OSError:
        size = 0  # reading it raises the error
    limits.check_bytes(shown(path), size)
    return read_bytes(path)


def load_picture(source: ImageSource) -> Image:
    """Return a checked picture from an array, a file or its content.

    Parameters
    ----------
    source : path, bytes, binary file, PIL.Image.Image or ndarray
        Arrays are of uint8, uint16 or float32, shape (H, W), (H, W, 3) or (H, W, 4), grey, BGR or
        BGRA; they may be strided views and are not copied. An alpha channel is dropped.

    Raises
    ------
    ImageError
        If a file is missing, truncated or not a picture.
    TypeError, ValueError
        If an array is of another type or shape, empty, or not finite.
    """
    return load_photograph(source)[0]


def load_photograph(
    source: ImageSource, limits: PictureLimits | None = None
) -> tuple[Image, OrientationTag | None]:
    """Return a picture as `load_picture` does, with its orientation tag if that would turn it."""
    if isinstance(source, str | os.PathLike):
        return read_photograph(source, limits)
    if isinstance(source, VideoFrame):
        return source.pixels, OrientationTag.of_steps(False, source.turn // 90)
    if hasattr(source, "read"):
        source = content_of(source)
    limits = PictureLimits.stated() if limits is None else limits
    if isinstance(source, bytes | bytearray | memoryview):
        return decode_photograph(bytes(source), "the encoded picture", limits)
    if is_pillow(source):
        return _checked_array(_pillow_pixels(source, limits)), _pillow_tag(source)
    return _checked_array(source), None


def _pillow_pixels(image: PillowImage, limits: PictureLimits) -> Image:
    """Return grey or BGR pixels; palettes and other colours become BGR."""
    limits.check_pixels("the Pillow image", image.size)
    try:
        if image.mode == "F" or image.mode.startswith("I"):  # 32-bit floats, 16-bit integers
            pixels = np.asarray(image)
            fits = pixels.dtype.kind != "i" or (pixels.min() >= 0 and pixels.max() < 1 << 16)
            pixel_type = np.uint16 if pixels.dtype.kind in "iu" else np.float32
            return pixels.astype(pixel_type) if fits else pixels
        if image.mode in ("L", "LA", "1"):
            return np.asarray(image.convert("L"))
        return np.asarray(image.convert("RGB"))[:, :, ::-1]
    except MemoryError:
        raise
    except Exception as error:  # its file is decoded only now; damage may raise any error
        raise ImageError(f"the Pillow image: {error}") from error


def _pillow_tag(image: PillowImage) -> OrientationTag | None:
    try:
        return OrientationTag.of(image.getexif().get(ORIENTATION))
    except Exception:  # its block is read only now; damage may raise any error
        return None


def _checked_array(source: object) -> Image:
    if not isinstance(source, np.ndarray):
        raise TypeError(
            "a picture must be a path, an array, bytes, a binary file or a Pillow image, "
            f"not {type(source).__name__}"
        )
    if np.ma.is_masked(source):
        raise ValueError("a picture must have no masked pixels: set them to the grey around them")
    if source.dtype not in PIXEL_TYPES:
        hint = ": picture.astype(np.float32)" if source.dtype == np.float64 else ""
        raise TypeError(f"pixels must be uint8, uint16 or float32, not {source.dtype}{hint}")
    if source.ndim not in (2, 3) or source.shape[2:] not in SHAPES or source.size == 0:
        raise ValueError(
            f"a picture must have the shape (H, W), (H, W, 3) or (H, W, 4), not {source.shape}"
        )
    pixels = source[:, :, :3] if source.shape[2:] == (4,) else source
    if pixels.dtype == np.float32 and not np.isfinite(pixels).all():
        raise ValueError("pixels must be finite")
    return pixels[:, :, 0] if pixels.shape[2:] == (1,) else pixels
