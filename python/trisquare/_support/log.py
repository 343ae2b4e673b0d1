"""The logger for slow operations, which is silent unless a program configures logging."""

from __future__ import annotations

import logging

LOG = logging.getLogger("trisquare")
LOG.addHandler(logging.NullHandler())
