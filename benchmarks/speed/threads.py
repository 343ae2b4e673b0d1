"""Two threads on two cores: throughput relative to one thread."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate

THREADS = 2
SEED = 11
PICTURES = 4
SCENES = 4
SPACING = 1.0  # pixels of edge per sample: some 3,000 samples
NOISE = 0.1  # pixels
# Seconds of one thread's work in a round, and number of rounds. The best rounds are compared,
# because other load on the machine can only slow a round down. They are short, to fit between such
# loads.
ROUND_SECONDS = 0.2
ROUNDS = 30
TARGET = 1.6

Job = Callable[[], object]


def measure() -> list[Row]:
    """Print the throughput of two threads over one's, from pictures and from edge points."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # otherwise OpenCV gives one thread both cores
    try:
        found = {
            "pictures": _speed_up([lambda shot=shot: ts.calibrate(shot) for shot in _pictures()]),
            "edge points": _speed_up(
                [lambda scene=scene: ts.calibrate_edges(*scene) for scene in _edges()]
            ),
        }
    finally:
        cv2.setNumThreads(threads)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    print(f"  on {cores} cores")
    return [
        Row(
            f"{name}: throughput of {THREADS} threads / of one",
            f"{ratio:.2f}",
            f">= {TARGET}",
            ratio >= TARGET,
        )
        for name, ratio in found.items()
    ]


def _pictures() -> list[Any]:
    pictures = []
    for seed in range(PICTURES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng, kind="frame" if seed % 2 else "square")
        pictures.append(simulate.render(scene, rng, noise=2.0, tone="srgb", colour=seed > 1))
    return pictures


def _edges() -> list[tuple[list[ts.PlaneEdges], tuple[int, int]]]:
    found = []
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, 100 + seed])
        scene = simulate.random_scene(rng)
        points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
        edges = [ts.PlaneEdges.square(sides) for sides in points]
        found.append((edges, scene.camera.image_size))
    return found


def _speed_up(jobs: Sequence[Job]) -> float:
    """Return the calibrations per second of all threads over those of one, in the best rounds."""
    once = _seconds_of(jobs, 1, 1)
    repeats = max(1, round(ROUND_SECONDS / once))
    alone, together = [], []
    for _ in range(ROUNDS):
        alone.append(_seconds_of(jobs, 1, repeats))
        together.append(_seconds_of(jobs, THREADS, repeats))
    ratio = THREADS * min(alone) / min(together)
    per_job = 1e3 * min(alone) / (repeats * len(jobs))
    print(f"  {per_job:.2f} ms each alone; {ratio:.2f} times as many in {THREADS} threads")
    return ratio


def _seconds_of(jobs: Sequence[Job], threads: int, repeats: int) -> float:
    """Return the seconds for `repeats` rounds of all jobs in every thread, with shifted starts."""

    def work(first: int) -> None:
        for _ in range(repeats):
            for job in (*jobs[first:], *jobs[:first]):
                job()

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(time.sleep, [0.0] * threads))  # wait until the threads exist
        start = time.perf_counter()
        list(pool.map(work, [number % len(jobs) for number in range(threads)]))
        return time.perf_counter() - start
