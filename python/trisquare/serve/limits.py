"""What one request may take."""

from __future__ import annotations

from trisquare.batch.limits import JobLimits
from trisquare.images.limits import stated_limit

MAX_PIXELS = 100_000_000
"""Of a picture: no phone and few cameras take more."""

MAX_BYTES = 200_000_000
"""Of a request: ten photographs of 20 MB."""

MAX_SECONDS = 60.0
"""That a request may compute: ten photographs of 24 megapixels take half of it."""

MAX_MEMORY = 2e9
"""Bytes that a request may take beside the program."""


def request_limits(max_pixels: float | None = None, max_bytes: float | None = None) -> JobLimits:
    """Return the limits of a request: those given, those of the environment, or the defaults.

    Raises
    ------
    TypeError, ValueError
        If one is not a positive number.
    """
    return JobLimits(
        int(stated_limit("max_pixels", max_pixels, MAX_PIXELS)),
        int(stated_limit("max_bytes", max_bytes, MAX_BYTES)),
        stated_limit("max_seconds", None, MAX_SECONDS),
        stated_limit("max_memory", None, MAX_MEMORY),
    )
