"""The log of what takes long, which is silent where a program has set up none."""

from __future__ import annotations

import logging

LOG = logging.getLogger("trisquare")
LOG.addHandler(logging.NullHandler())
