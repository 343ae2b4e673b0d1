"""`make demo` in a fresh clone: time, and files written.

The time includes downloads from the package registries.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from pathlib import Path

from harness.rows import NotMeasurableError, Row

TARGET = 90.0  # seconds
FILES = ("photo.png", "camera.json", "overlay.png", "report.html")
CHECKOUT = Path(__file__).parents[2]


def measure() -> list[Row]:
    """Print the time, and check that the four files are written."""
    # Variables of this run that a new user's shell does not have.
    own = ("VIRTUAL_ENV", "PYTHONPATH", "CARGO_TARGET_DIR", "MAKEFLAGS", "MAKELEVEL")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "trisquare"
        cloned = subprocess.run(
            ["git", "clone", "--quiet", str(CHECKOUT), str(clone)], capture_output=True, text=True
        )
        if cloned.returncode:
            raise NotMeasurableError(f"no clone of the checkout: {cloned.stderr.strip()}")
        start = time.perf_counter()
        subprocess.run(["make", "demo"], cwd=clone, check=True, env=environment)
        seconds = time.perf_counter() - start
        written = sum((clone / "demo-output" / name).stat().st_size > 0 for name in FILES)
    result = f"{seconds:.0f} s; {written} of {len(FILES)}"
    required = f"<= {TARGET:.0f} s; all"
    met = seconds <= TARGET and written == len(FILES)
    return [Row("time; files written", result, required, met)]
