"""How improbable a sum of squares is."""

from __future__ import annotations

import math


def chi_square_tail(statistic: float, freedom: int) -> float:
    """Return how often a chi-squared variable exceeds a value.

    The finite sums for whole degrees of freedom (Abramowitz & Stegun, 26.4.4 and 26.4.5).
    """
    if freedom == 0:
        return 1.0
    half = 0.5 * statistic
    if freedom % 2:
        total, power = math.erfc(math.sqrt(half)), 0.5
    else:
        total, power = math.exp(-half), 1.0
    while power < 0.5 * freedom:
        if half > 0:
            total += math.exp(power * math.log(half) - half - math.lgamma(power + 1.0))
        power += 1.0
    return min(total, 1.0)
