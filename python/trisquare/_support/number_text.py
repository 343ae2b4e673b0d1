"""Formatting of numbers and lists for people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def decimals_shown(std: float) -> int:
    """Return the number of decimals for two significant digits of a standard deviation."""
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 12)) if std > 0 else 6


def with_its_std(value: float, std: float) -> tuple[str, str]:
    """Format a number and its standard deviation with the decimals of `decimals_shown`."""
    decimals = decimals_shown(std)
    return f"{value:.{decimals}f}", f"{std:.{decimals}f}"


def plus_minus(value: float, std: float) -> str:
    """Format a number and its standard deviation as one text, "1.23 +- 0.04"."""
    return " +- ".join(with_its_std(value, std))


def listed(texts: Sequence[str], most: int | None = None) -> str:
    """Join texts as "a, b and c"; beyond the first `most` as "a, b and 5 more"."""
    shown = list(texts[:most])
    if len(texts) > len(shown):
        shown.append(f"{len(texts) - len(shown)} more")
    return " and ".join(text for text in (", ".join(shown[:-1]), shown[-1]) if text)
