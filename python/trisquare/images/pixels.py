"""Pictures as given by callers: arrays or files, checked once."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from trisquare._support.suggestions import unknown

Image: TypeAlias = npt.NDArray[Any]
Tone: TypeAlias = str | float | None
Outlines: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Sequence[Any]


class PillowImage(Protocol):
    """The members of `PIL.Image.Image` that are used."""

    @property
    def mode(self) -> str:
        """Kind of a pixel, such as ``"RGB"``."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""

    def convert(self, mode: str) -> Any:
        """Return the picture in another mode."""

    def getexif(self) -> Any:
        """Return the values of the Exif block by their tags."""


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A frame that was taken out of a video.

    Attributes
    ----------
    video : str
        Name of the file.
    number : int
        Number of the frame, counted from 0.
    pixels : ndarray of uint8, shape (H, W, 3)
        BGR, rows and columns as they are stored.
    turn : int
        Degrees by which players turn it clockwise: 0, 90, 180 or 270.
    """

    video: str
    number: int
    pixels: Image
    turn: int = 0


# Not a string, which `typing.get_type_hints` would look up in the module of the function.
ImageSource: TypeAlias = (
    str | os.PathLike[str] | bytes | BinaryIO | PillowImage | VideoFrame | Image
)

LARGEST_RESAMPLED = 32766
"""Maximum longer side, in pixels, of a picture that OpenCV resamples: it counts them in 16 bits."""

PIXEL_TYPES = (np.uint8, np.uint16, np.float32)
TONE_CURVES = ("srgb", "linear", "auto")
GAMMAS = 0.2, 5.0
"""Range of the gammas that are accepted; for most pictures it is some 2.2."""


def picture_size(picture: Image) -> tuple[int, int]:
    """Return ``(width, height)``."""
    return picture.shape[1], picture.shape[0]


INTEGER_SLACK = 0.02
"""Distance from an integer that rounding leaves a float of 32 bits; most values of light are at
least as far."""

ROWS_AT_ONCE = 256

NARROW_BITS = (8, 10, 12)
"""Numbers of bits of the values that machine-vision cameras write unscaled in 16 bits."""


def as_recorded(picture: Image) -> Image:
    """Return a picture of integers with 8 or 16 bits, of which the largest is white.

    Programs convert integers to floats, unscaled or as fractions of white, and leave their coding
    unchanged; 16 bits may contain values of fewer. Other pictures are returned unchanged.
    """
    if picture.dtype == np.uint16:
        return _scaled_to_all_bits(picture)
    if picture.dtype != np.float32:
        return picture
    blocks = [picture[i : i + ROWS_AT_ONCE] for i in range(0, len(picture), ROWS_AT_ONCE)]
    for kind in (np.uint8, np.uint16):
        for factor in (np.iinfo(kind).max, 1):
            integers = []
            for block in blocks:
                block_integers = _integers(block, factor, kind)
                if block_integers is None:
                    break
                integers.append(block_integers)
            else:
                return as_recorded(np.concatenate(integers))
    return picture


def _scaled_to_all_bits(picture: Image) -> Image:
    """Scale integers of fewer bits to 8 or 16; return those of 16 bits unchanged."""
    largest = picture.max()
    bits = next((bits for bits in NARROW_BITS if largest < 1 << bits), None)
    if bits is None:
        return picture
    if bits == 8:
        return picture.astype(np.uint8)
    # The first bits are repeated at the end, so that white stays white.
    return (picture << (16 - bits)) | (picture >> (2 * bits - 16))


def _integers(picture: Image, factor: int, kind: type[np.unsignedinteger[Any]]) -> Image | None:
    """Return floats times a factor as integers of a type; None if they are not integers."""
    scaled = picture * np.float32(factor)
    whole = np.rint(scaled)
    fits = whole.min() >= 0 and whole.max() <= np.iinfo(kind).max
    return whole.astype(kind) if fits and np.abs(scaled - whole).max() <= INTEGER_SLACK else None


def checked_tone(tone: Tone) -> str | float | None:
    """Check a tone curve and return it; a gamma may be given as text.

    Raises
    ------
    TypeError, ValueError
        If `tone` is neither a known curve, nor a gamma of `GAMMAS`, nor None.
    """
    if tone is None or (isinstance(tone, str) and tone in TONE_CURVES):
        return tone
    if isinstance(tone, bool) or not isinstance(tone, str | int | float | np.number):
        raise TypeError(f"tone must be a name or a gamma, not {type(tone).__name__}")
    try:
        gamma = float(tone)
    except ValueError:
        choices = "auto, srgb, linear, or a gamma"
        raise unknown("tone curve", str(tone), TONE_CURVES, choices) from None
    min_gamma, max_gamma = GAMMAS
    if not min_gamma <= gamma <= max_gamma:
        raise ValueError(f"a gamma must be from {min_gamma:g} to {max_gamma:g}, not {gamma:g}")
    return gamma


def tone_of(
    picture: Image, tone: str | float | None, *, is_camera_held: bool = False
) -> str | float:
    """Return the tone curve of a picture, unless stated: estimated for integers, linear for floats.

    Files contain 8 and 16 bits in any coding; floats are light that a program computed. The curve
    is mostly determined by the planes of a free camera: if the camera is held, 8 bits are taken as
    sRGB and 16 as linear.
    """
    if tone is not None:
        return tone
    if is_camera_held:
        return "srgb" if picture.dtype == np.uint8 else "linear"
    return "auto" if np.issubdtype(picture.dtype, np.integer) else "linear"
