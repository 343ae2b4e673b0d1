"""Time of `import trisquare`, relative to `import cv2`.

Each import is in a new interpreter, with bytecode compiled beforehand, as by pip. `import
trisquare` imports OpenCV, and the modules for pictures, only when a picture is searched; the second
row includes them.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile

from harness.rows import Row

REPETITIONS = 15
TARGET = 1.10
FIRST_PHOTOGRAPH = "trisquare, trisquare.images.reading, trisquare.measurement.measure"
"""Modules that `trisquare.calibrate` has imported before it searches a photograph."""

TIMED_IMPORT = """
import time
start = time.perf_counter()
import {modules}
print(time.perf_counter() - start)
"""


def measure() -> list[Row]:
    """Print the ratios of the median times, alternated, after one unmeasured round."""
    times: dict[str, list[float]] = {"cv2": [], "trisquare": [], FIRST_PHOTOGRAPH: []}
    with tempfile.TemporaryDirectory() as bytecode:
        for repetition in range(REPETITIONS + 1):
            for modules, seconds in times.items():
                taken = _import_seconds(modules, bytecode)
                if repetition > 0:  # the first round compiles and fills the disk cache
                    seconds.append(taken)
    opencv, ours, all_of_ours = (statistics.median(seconds) for seconds in times.values())
    return [
        Row(
            "time of `import trisquare` / time of `import cv2`",
            _ratio(ours, opencv),
            f"<= {TARGET:.2f}",
            ours / opencv <= TARGET,
        ),
        Row(
            "time of all imports for a photograph / time of `import cv2`",
            _ratio(all_of_ours, opencv),
            "",
            None,
        ),
    ]


def _ratio(ours: float, opencv: float) -> str:
    return f"{ours / opencv:.2f} ({1e3 * ours:.0f} ms / {1e3 * opencv:.0f} ms)"


def _import_seconds(modules: str, bytecode: str) -> float:
    code = TIMED_IMPORT.format(modules=modules)
    command = [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": bytecode}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    printed = subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment
    ).stdout
    return float(printed)
