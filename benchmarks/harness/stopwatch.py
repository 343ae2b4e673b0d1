"""Times of compared functions, run alternately so that other load affects all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence


def alternated_medians(functions: Sequence[Callable[[], object]], repetitions: int) -> list[float]:
    """Return the median seconds of each function after one unmeasured round."""
    for function in functions:
        function()
    times: list[list[float]] = [[] for _ in functions]
    for _ in range(repetitions):
        for function, seconds in zip(functions, times, strict=True):
            start = time.perf_counter()
            function()
            seconds.append(time.perf_counter() - start)
    return [statistics.median(seconds) for seconds in times]
