"""Times of functions that are compared, alternated so that a busy moment affects all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence


def alternated_medians(works: Sequence[Callable[[], object]], repetitions: int) -> list[float]:
    """Return the median seconds of each function after one unmeasured round."""
    for work in works:
        work()
    times: list[list[float]] = [[] for _ in works]
    for _ in range(repetitions):
        for work, seconds in zip(works, times, strict=True):
            start = time.perf_counter()
            work()
            seconds.append(time.perf_counter() - start)
    return [statistics.median(seconds) for seconds in times]
