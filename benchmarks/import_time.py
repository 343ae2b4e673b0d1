"""`import trisquare` beside `import cv2`, each in fresh interpreters."""

from __future__ import annotations

import statistics
import subprocess
import sys

from rows import Row

REPETITIONS = 15
TARGET = 1.15
TIMED_IMPORT = """
import time
start = time.perf_counter()
import {module}
print(time.perf_counter() - start)
"""


def measure() -> list[Row]:
    """Print the ratio of the median times, alternated, after one unmeasured round."""
    times: dict[str, list[float]] = {"trisquare": [], "cv2": []}
    for repetition in range(REPETITIONS + 1):
        for module, seconds in times.items():
            taken = _import_seconds(module)
            if repetition > 0:  # the first round fills the disk cache
                seconds.append(taken)
    ours, opencv = (statistics.median(seconds) for seconds in times.values())
    return [
        Row(
            "`import trisquare` / `import cv2`",
            f"{ours / opencv:.2f} ({1e3 * ours:.0f} ms / {1e3 * opencv:.0f} ms)",
            f"<= {TARGET}",
            ours / opencv <= TARGET,
        )
    ]


def _import_seconds(module: str) -> float:
    code = TIMED_IMPORT.format(module=module)
    command = [sys.executable, "-c", code]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
