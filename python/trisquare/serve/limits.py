"""What one request may take."""

from __future__ import annotations

from trisquare.batch.limits import JobLimits

MAX_PIXELS = 100_000_000
"""Of a picture: no phone and few cameras take more."""

MAX_BYTES = 200_000_000
"""Of a request: ten photographs of 20 MB."""

MAX_SECONDS = 60.0
"""That a request may compute: ten photographs of 24 megapixels take half of it."""

MAX_MEMORY = 2e9
"""Bytes that a request may take beside the program."""

MAX_PICTURES = 100
"""Of a request."""

REQUEST_LIMITS = JobLimits(MAX_PIXELS, MAX_BYTES, MAX_SECONDS, MAX_MEMORY)
"""Where neither the command nor the environment states others."""
