"""Limits of time, memory and size of one job."""

from __future__ import annotations

from dataclasses import dataclass

from trisquare.images.limits import (
    MAX_BYTES,
    MAX_FRAMES,
    MAX_PIXELS,
    MAX_SCANS,
    PictureLimits,
    stated_count,
    stated_limit,
)

MAX_SECONDS = 300.0
"""Maximum time of a job, seconds: a hundred photographs of 24 megapixels take half of it on a slow
machine."""

MAX_MEMORY = 4e9
"""Maximum memory of a job in addition to the program, bytes: a colour picture of 350 megapixels."""


@dataclass(frozen=True, slots=True)
class JobLimits:
    """The limits of every job of a batch.

    Attributes
    ----------
    max_pixels : int
        Maximum number of pixels of a picture, by its header.
    max_bytes : int
        Maximum size of a picture's file, bytes.
    max_seconds : float
        Maximum time of a job, seconds.
    max_memory : float
        Maximum memory of a job in bytes, in addition to the program; only on Linux.
    max_scans : int
        Maximum number of scans of a progressive JPEG.
    max_frames : int
        Maximum number of frames of a video that frames are chosen from.
    """

    max_pixels: int
    max_bytes: int
    max_seconds: float
    max_memory: float
    max_scans: int = MAX_SCANS
    max_frames: int = MAX_FRAMES

    @classmethod
    def stated(
        cls,
        max_pixels: float | None = None,
        max_bytes: float | None = None,
        max_seconds: float | None = None,
        max_memory: float | None = None,
        *,
        defaults: JobLimits | None = None,
    ) -> JobLimits:
        """Return the given limits; None is replaced by the environment's, or by the default.

        Limits of scans and frames come only from the environment.

        Raises
        ------
        TypeError, ValueError
            If one is not a positive number.
        """
        usual = DEFAULTS if defaults is None else defaults
        return cls(
            stated_count("max_pixels", max_pixels, usual.max_pixels),
            stated_count("max_bytes", max_bytes, usual.max_bytes),
            stated_limit("max_seconds", max_seconds, usual.max_seconds),
            stated_limit("max_memory", max_memory, usual.max_memory),
            stated_count("max_scans", None, usual.max_scans),
            stated_count("max_frames", None, usual.max_frames),
        )

    @property
    def of_pictures(self) -> PictureLimits:
        """Limits of each picture or video."""
        return PictureLimits(self.max_pixels, self.max_bytes, self.max_scans, self.max_frames)


DEFAULTS = JobLimits(MAX_PIXELS, MAX_BYTES, MAX_SECONDS, MAX_MEMORY)
