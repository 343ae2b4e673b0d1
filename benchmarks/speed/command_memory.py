"""Peak memory of `trisquare calibrate`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row

from trisquare import simulate

SEED = 8
TARGET = 110.0  # MB
KIBIBYTE = 1024 / 1e6  # MB; the unit of ru_maxrss on Linux

# Runs a command and prints its peak memory. It is a small process of its own, because on Linux a
# child inherits the peak of its parent.
WATCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def measure() -> list[Row]:
    """Print the peak of `trisquare calibrate`, alone and with an overlay."""
    picture, _, _ = simulate.photo_like(np.random.default_rng(SEED))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "photo.png"
        cv2.imwrite(str(path), picture)
        alone = _peak(["calibrate", str(path)])
        drawn = _peak(["calibrate", str(path), "--overlay", str(Path(folder) / "overlay.png")])
    print(f"  colour picture: {alone:.0f} MB, with an overlay {drawn:.0f} MB")
    worst = max(alone, drawn)
    return [
        Row(
            "colour picture of 1280 x 960: peak memory with or without an overlay",
            f"{worst:.0f} MB",
            f"<= {TARGET:.0f} MB",
            worst <= TARGET,
        )
    ]


def _peak(arguments: list[str]) -> float:
    """Return the peak resident memory of the command, in MB."""
    command = [sys.executable, "-c", WATCHER, sys.executable, "-m", "trisquare", *arguments]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return int(printed) * KIBIBYTE
