"""Noisy edge points: error relative to the Cramer-Rao bound, and coverage.

Three squares with a sample every 4 px of edge and white noise of 0.05-0.5 px.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row
from harness.truth import NAMES, by_name, errors, rms, rms_per_parameter

import trisquare as ts
from trisquare import simulate

SCENES = 200
SEED = 1
NOISE_RANGE = (0.05, 0.5)  # pixels
SPACING = 4.0  # pixels of edge per sample
# An estimate below the lower end would beat the bound, so the bound would be wrong.
TARGET = (0.93, 1.08)
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964


def measure() -> list[Row]:
    """Print error / bound for every parameter, and the coverage of the intervals."""
    ratios, covered = np.zeros((2, SCENES, len(NAMES)))
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng)
        noise = rng.uniform(*NOISE_RANGE)
        points = simulate.edge_points(scene, rng, noise=noise, spacing=SPACING)
        edges = [ts.PlaneEdges.square(sides) for sides in points]
        result = ts.calibrate_edges(edges, scene.camera.image_size)
        error = errors(result, scene.camera)
        ratios[seed] = error / by_name(simulate.cramer_rao_bound(scene, noise, spacing=SPACING))
        covered[seed] = np.abs(error) <= HALF_WIDTH * by_name(result.std)
    ratio = rms(ratios)
    print(f"  error / bound: {rms_per_parameter(ratios)}")
    shares = ", ".join(
        f"{name} {100 * share:.1f} %" for name, share in zip(NAMES, covered.mean(0), strict=True)
    )
    print(f"  coverage of the 95 % intervals: {shares}")
    return [
        Row(
            f"{SCENES} scenes: error / Cramer-Rao bound",
            f"{ratio:.3f}",
            f"{TARGET[0]}-{TARGET[1]}",
            TARGET[0] <= ratio <= TARGET[1],
        ),
        Row(
            f"{SCENES} scenes: coverage of the 95 % intervals",
            f"{100 * covered.mean():.1f} %",
            "",
            None,
        ),
    ]
