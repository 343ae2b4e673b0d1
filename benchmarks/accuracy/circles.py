"""Concentric circles on three planes, from edge points: error and coverage."""

from __future__ import annotations

import numpy as np
from harness.rows import Row, bound_row, coverage_row
from harness.truth import by_name, errors, rms

import trisquare as ts
from trisquare import simulate
from trisquare_scenes.circles import circle_bound, circle_edges

SCENES = 200
SEED = 79
RADII = (0.5, 0.3)
NOISE = 0.1  # pixels
MAX_OVER_BOUND = 1.10
COVERAGE = (0.93, 0.97)
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964


def measure() -> list[Row]:
    """Print the errors relative to the edges' bound, and the coverage of the intervals."""
    rows = []
    for radii, name in ((RADII, "known"), (None, "unknown")):
        ratio, share = _of_scenes(radii)
        scenes = f"two circles a plane, {name} radii, {SCENES} scenes"
        rows += [
            bound_row(scenes, ratio, MAX_OVER_BOUND),
            coverage_row(scenes, share, COVERAGE),
        ]
    return rows


def _of_scenes(radii: tuple[float, ...] | None) -> tuple[float, float]:
    """Return error / bound of the camera's six parameters, and the coverage of their intervals."""
    ratios, covered = [], []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        scene = simulate.random_scene(rng)
        points = circle_edges(scene, rng, RADII, noise=NOISE)
        edges = [ts.PlaneEdges.circles(circles, radii) for circles in points]
        result = ts.calibrate_edges(edges, scene.camera.image_size)
        error = errors(result, scene.camera)
        bound = circle_bound(scene, RADII, noise=NOISE, any_radii=radii is None)
        ratios.append(error / by_name(bound))
        covered.append(np.abs(error) <= HALF_WIDTH * by_name(result.std))
    return rms(np.array(ratios)), float(np.mean(covered))
