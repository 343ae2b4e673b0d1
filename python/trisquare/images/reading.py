"""Reading photographs whole."""

from __future__ import annotations

import os

import numpy as np

from trisquare._support.paths import read_bytes
from trisquare._support.writing import PathLike
from trisquare.errors import ImageError, MissingImageError
from trisquare.images.header import stated_size
from trisquare.images.integrity import incompleteness
from trisquare.images.limits import PictureLimits
from trisquare.images.orientation import TIFF_STARTS, find_orientation
from trisquare.images.pixels import PIXEL_TYPES, Image, ImageSource

NO_MEMORY = -4
"""OpenCV's code for it, which it names differently from version to version."""


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
        If the file is missing (`MissingImageError`), is no picture, or is truncated (OpenCV alone
        may return a truncated picture with its lower part grey); if its pixels are signed, of
        32-bit integers or of 64-bit floats, or NaN.
    """
    return read_photograph(path)[0]


def read_photograph(
    path: PathLike, limits: PictureLimits | None = None
) -> tuple[Image, str | None]:
    """Read a photograph as `read_image` does, and say how its orientation tag would turn it.

    The text says what the orientation tag asks for; it is None without a tag, or for an upright
    picture. `limits` are by default those of the environment.
    """
    limits = PictureLimits.stated() if limits is None else limits
    try:
        encoded = _bytes_within(path, limits)
    except FileNotFoundError as error:
        raise MissingImageError(str(error)) from error
    except OSError as error:
        raise ImageError(str(error)) from error
    _check_pixels(path, encoded, limits)
    reason = incompleteness(encoded)
    if reason:
        raise ImageError(f"{os.fspath(path)}: {reason}")
    tag = find_orientation(encoded)
    turn = None if tag is None else tag.turn
    if tag is not None and turn is not None and encoded[:4] in TIFF_STARTS:
        encoded = tag.made_upright(encoded)
    import cv2  # loaded where a file is read

    # Grey stays grey and 16 bits stay 16. The orientation tag is ignored: the camera matrix
    # belongs to the picture as the sensor delivered it. (For TIFF, OpenCV applies it all the same.)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(encoded, np.uint8), flags)
    except cv2.error as error:
        if error.code == NO_MEMORY:
            raise MemoryError(f"{os.fspath(path)}: not enough memory to decode it") from error
        raise ImageError(f"{os.fspath(path)}: not a readable picture") from error
    if image is None:
        raise ImageError(f"{os.fspath(path)}: not a readable picture")
    if image.dtype not in PIXEL_TYPES:
        raise ImageError(f"{os.fspath(path)}: pixels of type {image.dtype} are not supported")
    if image.dtype == np.float32 and not np.isfinite(image).all():
        raise ImageError(f"{os.fspath(path)}: some pixels are NaN or infinite")
    return image, turn


def _bytes_within(path: PathLike, limits: PictureLimits) -> bytes:
    try:
        size = os.stat(path).st_size
    except OSError:
        size = 0  # reading it says why
    if size > limits.max_bytes:
        raise ImageError(
            f"{os.fspath(path)}: has {size} bytes, more than the {limits.max_bytes} that "
            "max_bytes allows"
        )
    return read_bytes(path)


def _check_pixels(path: PathLike, encoded: bytes, limits: PictureLimits) -> None:
    width, height = stated_size(encoded) or (0, 0)
    if width * height > limits.max_pixels:
        raise ImageError(
            f"{os.fspath(path)}: has {width} x {height} pixels, more than the "
            f"{limits.max_pixels} that max_pixels allows"
        )


def load_picture(source: ImageSource) -> Image:
    """Return a checked picture from an array or a file.

    Parameters
    ----------
    source : path or ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR; arrays may be strided views and are not copied.

    Raises
    ------
    ImageError
        If a file is missing, truncated or no picture.
    TypeError, ValueError
        If an array is of another type or shape, empty, or not finite.
    """
    if isinstance(source, str | os.PathLike):
        return read_image(source)
    if not isinstance(source, np.ndarray):
        raise TypeError(f"a picture is a path or a numpy array, not {type(source).__name__}")
    if source.dtype not in PIXEL_TYPES:
        raise TypeError(f"pixels must be uint8, uint16 or float32, not {source.dtype}")
    if source.ndim not in (2, 3) or source.shape[2:] not in ((), (1,), (3,)) or source.size == 0:
        raise ValueError(f"a picture has the shape (H, W) or (H, W, 3), not {source.shape}")
    if source.dtype == np.float32 and not np.isfinite(source).all():
        raise ValueError("pixels must be finite")
    return source[:, :, 0] if source.shape[2:] == (1,) else source
