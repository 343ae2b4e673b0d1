"""Pictures like photographs: error of fx without options.

sRGB pictures of squares or frames, in colour, with clutter and shading.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate

SCENES = 30
SEED = 3
MEDIAN_TARGET = 0.012  # per cent of fx
WORST_TARGET = 0.08


def measure() -> list[Row]:
    """Print median and worst error of fx, and the pictures whose targets were missed."""
    percents, deviations, missed = [], [], 0
    for seed in range(SCENES):
        picture, scene, settings = simulate.photo_like(np.random.default_rng([SEED, seed]))
        try:
            result = ts.calibrate(picture)
        except ts.TrisquareError as error:
            print(f"  scene {seed}: {error}")
            missed += 1
            continue
        if len(result.planes) != len(scene.targets):
            print(f"  scene {seed}: {len(result.planes)} planes found")
            missed += 1
        error = result.camera.fx - scene.camera.fx
        percents.append(100.0 * abs(error) / scene.camera.fx)
        deviations.append(error / result.std["fx"])
        if percents[-1] > WORST_TARGET:
            print(f"  scene {seed}: fx off by {percents[-1]:.3f} %, {settings}")
    median, worst = float(np.median(percents)), max(percents)
    spread = float(np.sqrt(np.mean(np.square(deviations))))
    print(f"  stage {result.stage}; rms error of fx in its stated std {spread:.2f}")
    return [
        Row(
            f"{SCENES} pictures: error of fx; pictures with a target missed",
            f"median {median:.4f} %, worst {worst:.3f} %, missed {missed}",
            f"median <= {MEDIAN_TARGET} %, worst <= {WORST_TARGET} %, none missed",
            median <= MEDIAN_TARGET and worst <= WORST_TARGET and missed == 0,
        )
    ]
