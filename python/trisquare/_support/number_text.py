"""Numbers as people read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    pass


def decimals_shown(std: float) -> int:
    """Return the decimals that show two significant digits of a standard deviation."""
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 12)) if std > 0 else 6
