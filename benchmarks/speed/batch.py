"""Batches: throughput of two processes, overhead, and memory by the number of jobs."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate

SEED = 14
PICTURES = 10
JOBS = 1_000
"""Number of jobs in a run: the pictures under other names. Processes start within half a second."""

ROUNDS = 2
MIN_SPEED_UP = 1.85
MAX_OVERHEAD = 3.0  # per cent

FEW, MANY = 1_000, 100_000
MAX_GROWTH = 50.0  # MB

# The jobs return immediately, without waiting for the disk; the rest, files included, is as in a
# batch.
MEMORY = """
import os, resource, sys
import trisquare as ts
from trisquare.batch.limits import JobLimits
from trisquare.batch.run import Submission, finished
from trisquare.batch.store import Store

sys.path.insert(0, {here!r})
from stub_job import stub

os.fsync = lambda descriptor: None
limits = JobLimits.stated()
jobs = (ts.Job(f"camera-{{n}}", (f"folder/{{n}}.png",)) for n in range({count}))
with Store({folder!r}, limits) as store, Submission(None, 2, limits, stub) as submit:
    for result in finished(jobs, submit, store):
        pass
    store.finish()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
"""


def measure() -> list[Row]:
    """Print throughput, overhead and memory."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        speed_up, overhead = _speeds(folder)
        growth = _memory(folder, MANY) - _memory(folder, FEW)
    return [
        Row(
            f"{JOBS:,} pictures of 1280 x 960: throughput of two processes / of one",
            f"{speed_up:.2f}",
            f">= {MIN_SPEED_UP}",
            speed_up >= MIN_SPEED_UP,
        ),
        Row(
            f"{JOBS:,} pictures, one process: time beyond that of the calibrations",
            f"{overhead:+.1f} %",
            f"<= {MAX_OVERHEAD:.0f} %",
            overhead <= MAX_OVERHEAD,
        ),
        Row(
            f"{MANY:,} jobs: peak memory above that of {FEW:,}",
            f"{growth:+.0f} MB",
            f"<= {MAX_GROWTH:.0f} MB",
            growth <= MAX_GROWTH,
        ),
    ]


def _speeds(folder: Path) -> tuple[float, float]:
    """Return the speed-up of a second process and the overhead of a batch in per cent."""
    pictures = _pictures(folder)
    jobs = [ts.Job(f"camera-{n}", (pictures[n % PICTURES],)) for n in range(JOBS)]
    runs = 0

    def batch(workers: int) -> None:
        nonlocal runs
        runs += 1
        results = ts.calibrate_many(jobs, output=folder / f"run-{runs}", workers=workers)
        assert sum(own.is_done for own in results) == JOBS

    def alone() -> None:
        for job in jobs:
            ts.calibrate(job.photographs[0]).to_json()

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times: dict[str, list[float]] = {"one": [], "two": [], "alone": []}
        for _ in range(ROUNDS):
            times["alone"].append(_seconds(alone))
            times["one"].append(_seconds(lambda: batch(1)))
            times["two"].append(_seconds(lambda: batch(2)))
    finally:
        cv2.setNumThreads(threads)
    one, two, calibrations = (statistics.median(times[key]) for key in ("one", "two", "alone"))
    print(
        f"  {1e3 * calibrations / JOBS:.1f} ms a calibration; {JOBS} in {one:.1f} s by one process "
        f"and {two:.1f} s by two; load {os.getloadavg()[0]:.1f}"
    )
    return one / two, 100.0 * (one / calibrations - 1.0)


def _memory(folder: Path, count: int) -> float:
    """Return the peak resident memory, in MB, of a process that runs `count` jobs."""
    here = str(Path(__file__).parent)
    script = MEMORY.format(here=here, count=count, folder=str(folder / f"memory-{count}"))
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, check=True
    )
    print(f"  {count:,} jobs: {float(done.stdout):.1f} MB, {time.perf_counter() - start:.0f} s")
    return float(done.stdout)


def _pictures(folder: Path) -> list[str]:
    paths = []
    for seed in range(PICTURES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng, kind="frame" if seed % 2 else "square")
        picture = simulate.render(scene, rng, noise=2.0, tone="srgb")
        paths.append(str(folder / f"{seed}.png"))
        cv2.imwrite(paths[-1], picture)
    return paths


def _seconds(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
