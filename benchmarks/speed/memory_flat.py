"""Growth of the memory of a process that calibrates many times, after a warm-up."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from harness.rows import NotMeasurableError, Row

import trisquare as ts
from trisquare import simulate

SEED = 12
SCENES = 8
SPACING = 12.0  # pixels of edge per sample
NOISE = 0.1  # pixels
CALIBRATIONS = 20_000
PICTURES = 400
SIZE = (640, 480)
# Fraction of the calibrations after which the allocator has enough memory; a leak continues.
WARM_UP = 0.1
# One float64 kept per calibration would take 0.2 MB for 20,000, its Python object 1.1 MB, a result
# 60 MB. Allocators vary by some tenths of a megabyte.
TARGET = 1.0  # MB
ACCOUNT = Path("/proc/self/statm")


def measure() -> list[Row]:
    """Print the growth of resident memory over edge-point calibrations and over pictures."""
    if not ACCOUNT.exists():
        raise NotMeasurableError("no /proc/self/statm")
    edges = [_edges(np.random.default_rng([SEED, seed])) for seed in range(SCENES)]
    photos = [_photo(np.random.default_rng([SEED, 100 + seed])) for seed in range(SCENES)]
    by_edges = _growth(
        lambda count: _calibrate_or_refuse(edges[count % SCENES], count), CALIBRATIONS
    )
    by_pictures = _growth(lambda count: ts.calibrate(photos[count % SCENES]), PICTURES)
    return [
        Row(
            f"{count:,} calibrations from {source}: growth of memory",
            f"{growth:+.2f} MB",
            f"<= {TARGET:.0f} MB",
            growth <= TARGET,
        )
        for source, count, growth in (
            ("edge points", CALIBRATIONS, by_edges),
            ("pictures", PICTURES, by_pictures),
        )
    ]


def _growth(calibrate: Callable[[int], object], times: int) -> float:
    """Return the growth of resident memory, in MB, from the end of the warm-up to the end."""
    for count in range(round(WARM_UP * times)):
        calibrate(count)
    sizes = [_resident()]
    for tenth in range(10):
        for count in range(tenth * times // 10, (tenth + 1) * times // 10):
            calibrate(count)
        sizes.append(_resident())
    print(f"  after every tenth of {times:,}: {', '.join(f'{size:.1f}' for size in sizes)} MB")
    return sizes[-1] - sizes[0]


def _resident() -> float:
    gc.collect()
    return int(ACCOUNT.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _calibrate_or_refuse(edges: list[ts.PlaneEdges], count: int) -> None:
    """Calibrate; every eighth time from too little data, because errors must not leak either."""
    if count % 8:
        ts.calibrate_edges(edges, SIZE)
        return
    try:
        ts.calibrate_edges(edges[:1], SIZE)
    except ts.NotEnoughPlanesError:
        return
    raise RuntimeError("one plane was enough")


def _edges(rng: np.random.Generator) -> list[ts.PlaneEdges]:
    scene = simulate.random_scene(rng, image_size=SIZE)
    points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    return [ts.PlaneEdges.square(sides) for sides in points]


def _photo(rng: np.random.Generator) -> np.ndarray:
    scene = simulate.random_scene(rng, image_size=SIZE)
    return simulate.render(scene, rng, noise=2.0, tone="srgb")
