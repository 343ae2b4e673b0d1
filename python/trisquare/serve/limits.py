"""Limits of one request."""

from __future__ import annotations

from trisquare.batch.limits import JobLimits

MAX_PIXELS = 100_000_000
"""Maximum number of pixels of a picture: no phone and few cameras take more."""

MAX_BYTES = 200_000_000
"""Maximum number of bytes of a request: ten photographs of 20 MB."""

MAX_SECONDS = 60.0
"""Maximum time of computing a request, seconds; ten photographs of 24 megapixels take half."""

MAX_MEMORY = 2e9
"""Maximum memory of a request in addition to the program, bytes."""

MAX_PICTURES = 100
"""Maximum number of pictures of a request."""

REQUEST_LIMITS = JobLimits(MAX_PIXELS, MAX_BYTES, MAX_SECONDS, MAX_MEMORY)
"""Default limits, if neither the command nor the environment states others."""
