"""`import trisquare` beside `import cv2`, each in fresh interpreters.

Both are compiled to bytecode beforehand, as by pip: where the environment forbids Python to write
bytecode, an editable installation would be compiled at every import.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile

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
    with tempfile.TemporaryDirectory() as bytecode:
        for repetition in range(REPETITIONS + 1):
            for module, seconds in times.items():
                taken = _import_seconds(module, bytecode)
                if repetition > 0:  # the first round compiles, and fills the disk cache
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


def _import_seconds(module: str, bytecode: str) -> float:
    code = TIMED_IMPORT.format(module=module)
    command = [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": bytecode}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    printed = subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment
    ).stdout
    return float(printed)
