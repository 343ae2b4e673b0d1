"""Limits on the size of pictures and videos: files of strangers may expand to any size."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from numbers import Real

from trisquare.errors import ImageError

MAX_PIXELS = 500_000_000
"""Maximum number of pixels of a picture. Cameras that combine several exposures reach 400
megapixels; decoded in colour, 500 take 1.5 GB."""

MAX_BYTES = 2**31 - 1
"""Maximum size of a file in bytes: OpenCV decodes no more."""

MAX_SCANS = 100
"""Maximum number of scans of a progressive JPEG. Encoders write 10, and 20 if they optimise; each
is decoded over the whole picture, so that a small file may take minutes."""

MAX_FRAMES = 100_000
"""Maximum number of frames of a video from which frames are chosen: an hour at 27 frames a second.
All are decoded."""

SLOWEST_PIXELS = 2e6
"""Minimum speed of decoding a video, pixels per second of processor time. The slowest coding on the
slowest machine is faster; a frame that hides a far larger one, which OpenCV scales to the stated
size, is slower."""

MAX_SECONDS_MORE = 3.0
"""Processor time in seconds that decoding a video may take in addition, for its start."""

AMOUNT = re.compile(r"(\d+(?:\.\d+)?(?:e\d+)?)([kMG]?)", re.ASCII)
FACTORS = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


@dataclass(frozen=True, slots=True)
class PictureLimits:
    """Limits on the file of a picture or a video.

    Attributes
    ----------
    max_pixels : int
        Width times height, as its header states them.
    max_bytes : int
        Size of the file in bytes.
    max_scans : int
        Number of scans of a progressive JPEG.
    max_frames : int
        Number of frames of a video from which frames are chosen.
    """

    max_pixels: int = MAX_PIXELS
    max_bytes: int = MAX_BYTES
    max_scans: int = MAX_SCANS
    max_frames: int = MAX_FRAMES

    def check_pixels(self, name: str, size: tuple[int, int]) -> None:
        """Raise ImageError if a picture of this width and height has too many pixels."""
        width, height = size
        if width * height > self.max_pixels:
            raise ImageError(
                f"{name}: has {width} x {height} pixels, more than the {self.max_pixels} that "
                "max_pixels allows (TRISQUARE_MAX_PIXELS)"
            )

    def check_bytes(self, name: str, size: int) -> None:
        """Raise ImageError if a file of this size is too large."""
        if size > self.max_bytes:
            raise ImageError(
                f"{name}: has {size} bytes, more than the {self.max_bytes} that max_bytes allows "
                "(TRISQUARE_MAX_BYTES)"
            )

    def check_frames(self, name: str, count: int) -> None:
        """Raise ImageError if a video has, or states, too many frames."""
        if count > self.max_frames:
            raise ImageError(
                f"{name}: has more than the {self.max_frames} frames that max_frames allows "
                "(TRISQUARE_MAX_FRAMES): cut out the part that shows the targets"
            )

    @classmethod
    def stated(
        cls,
        max_pixels: float | None = None,
        max_bytes: float | None = None,
        max_scans: float | None = None,
        max_frames: float | None = None,
    ) -> PictureLimits:
        """Return the given limits; for None, those of the environment, or else the defaults.

        Raises
        ------
        TypeError, ValueError
            If one is not a positive number.
        """
        return cls(
            stated_count("max_pixels", max_pixels, MAX_PIXELS),
            stated_count("max_bytes", max_bytes, MAX_BYTES),
            stated_count("max_scans", max_scans, MAX_SCANS),
            stated_count("max_frames", max_frames, MAX_FRAMES),
        )


def stated_limit(name: str, given: float | None, default: float) -> float:
    """Return a limit: the given one, or the environment's ``TRISQUARE_NAME``, or the default.

    An empty variable counts as absent.

    Raises
    ------
    TypeError, ValueError
        If it is not a positive number.
    """
    if given is None:
        variable = f"TRISQUARE_{name.upper()}"
        text = os.environ.get(variable)
        return parse_amount(text, variable) if text else default
    if isinstance(given, bool) or not isinstance(given, Real):
        raise TypeError(f"{name} must be a number, not {type(given).__name__}")
    if not 0 < given < float("inf"):
        raise ValueError(f"{name} must be positive and finite, not {given}")
    return float(given)


def stated_count(name: str, given: float | None, default: int) -> int:
    """Return the limit of a count, as `stated_limit`.

    Raises
    ------
    TypeError, ValueError
        If it is not a positive whole number.
    """
    limit = stated_limit(name, given, default)
    if limit != int(limit):
        raise ValueError(f"{name} must be a whole number, not {limit:g}")
    return int(limit)


def parse_amount(text: str, name: str) -> float:
    """Return the positive number in a text such as ``500M`` or ``0.5G``.

    Raises
    ------
    ValueError
        If there is none; the message begins with the name.
    """
    match = AMOUNT.fullmatch(text.strip())
    amount = float(match[1]) * FACTORS[match[2]] if match else 0.0
    if not 0 < amount < float("inf"):
        raise ValueError(f"{name} must be a positive number, as 500M or 4G, not {text!r}")
    return amount
