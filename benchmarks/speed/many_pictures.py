"""A hundred colour pictures of 2 megapixels from files: throughput and peak memory.

"Read and measured" is without the fit.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from harness.rows import NotMeasurableError, Row

from trisquare import simulate

SEED = 14
SIZE = (1632, 1224)
PICTURES = 100
# Number of rendered scenes. The pictures are copies with different noise, which is faster.
SCENES = 4
NOISE = 1.5  # grey levels
THREADS = 2
MIN_RATIO = 1.85
MAX_GROWTH = 30.0  # MB

# Run in a process of its own, with one OpenCV thread, so that the peak is that of one calibration.
PROGRAM = """
import json, sys, time
import cv2
cv2.setNumThreads(1)
import trisquare as ts

def peak():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3

threads, paths = int(sys.argv[1]), sys.argv[2:]
measured = []
start = time.perf_counter()
result = ts.calibrate(
    paths,
    threads=threads,
    progress=lambda *_: measured.append((time.perf_counter() - start, peak())),
)
seconds = time.perf_counter() - start
assert len(result.planes) == 3 * len(paths), result.warnings
print(json.dumps([*measured[-1], seconds, peak()]))
"""


class Run(NamedTuple):
    """Seconds and peak memory (MB) until all pictures are measured, and until the result."""

    measured_seconds: float
    measured_peak: float
    seconds: float
    peak: float


def measure() -> list[Row]:
    """Print times and peaks of one picture and of a hundred."""
    if not Path("/proc/self/status").exists():
        raise NotMeasurableError("no /proc/self/status")
    with tempfile.TemporaryDirectory() as folder:
        paths = _written(Path(folder))
        alone = _run(1, paths[:1])
        many = {threads: _run(threads, paths) for threads in (THREADS, 1)}
    for name, run in (("one picture", alone), *((f"{t} threads", own) for t, own in many.items())):
        print(
            f"  {name}: measured after {run.measured_seconds:.1f} s, peak {run.measured_peak:.0f} "
            f"MB; result after {run.seconds:.1f} s, peak {run.peak:.0f} MB"
        )
    one, two = many[1], many[THREADS]
    ratios = {
        "read and measured": one.measured_seconds / two.measured_seconds,
        "calibrated": one.seconds / two.seconds,
    }
    growths = {
        "read and measured": one.measured_peak - alone.measured_peak,
        "calibrated": one.peak - alone.peak,
    }
    return [
        *(
            Row(
                f"{what}: throughput of {THREADS} threads / of one",
                f"{ratio:.2f}",
                f">= {MIN_RATIO}",
                ratio >= MIN_RATIO,
            )
            for what, ratio in ratios.items()
        ),
        *(
            Row(
                f"{what}, one thread: peak memory above that of one picture",
                f"{growth:.0f} MB",
                f"<= {MAX_GROWTH:.0f} MB",
                growth <= MAX_GROWTH,
            )
            for what, growth in growths.items()
        ),
    ]


def _written(folder: Path) -> list[str]:
    """Render a few scenes of one camera without noise, and write copies with different noise."""
    pictures = []
    camera = None
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng, image_size=SIZE, camera=camera)
        camera = scene.camera
        picture = simulate.render(scene, rng, noise=0.0, tone="srgb", colour=True, dtype=np.float32)
        pictures.append(255.0 * picture)
    rng = np.random.default_rng(SEED)
    paths = []
    for index in range(PICTURES):
        picture = pictures[index % SCENES]
        noisy = picture + NOISE * rng.standard_normal(picture.shape, dtype=np.float32)
        paths.append(str(folder / f"{index}.png"))
        fast = (cv2.IMWRITE_PNG_COMPRESSION, 1)
        cv2.imwrite(paths[-1], np.clip(noisy.round(), 0, 255).astype(np.uint8), fast)
    return paths


def _run(threads: int, paths: list[str]) -> Run:
    command = [sys.executable, "-c", PROGRAM, str(threads), *paths]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return Run(*json.loads(done.stdout))
