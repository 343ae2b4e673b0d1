"""Fisheye lenses of 100-220 degrees from edge points: optimum, error, coverage and time.

The two times are of different scenes: those of the usual distribution for `radial2`.
"""

from __future__ import annotations

import time

import numpy as np
from harness.rows import Row, bound_row, coverage_row
from harness.truth import Array, rms

import trisquare as ts
from trisquare import simulate

SCENES = 60
SEED = 71
FIELDS = (100, 130, 160, 190, 220)  # degrees across the picture's width
NOISE = 0.1  # pixels
SPACING = 6.0  # pixels of edge per sample
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
MAX_OVER_BOUND = 1.10
COVERAGE = (0.93, 0.97)
MAX_COST = 1.5
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964
# Distance, in standard deviations, below which two searches have found the same optimum.
SAME = 1e-3


def measure() -> list[Row]:
    """Print error / bound and coverage by field of view, and how often the optimum is reached."""
    every_ratio, every_covered, reached, beyond = [], [], 0, 0
    for field in FIELDS:
        ratios, covered = np.zeros((2, SCENES, len(NAMES)))
        own_reached = 0
        for number in range(SCENES):
            rng = np.random.default_rng([SEED, field, number])
            scene = simulate.wide_scene(rng, simulate.fisheye(field))
            edges = _edges(scene, rng)
            result = ts.calibrate_edges(edges, scene.camera.image_size, model="fisheye")
            error = values(result.camera) - values(camera_of(scene))
            std = np.array([result.std[name] for name in NAMES])
            bound = simulate.cramer_rao_bound(scene, NOISE, spacing=SPACING, free=NAMES)
            ratios[number] = error / [bound[name] for name in NAMES]
            covered[number] = np.abs(error) <= HALF_WIDTH * std
            own_reached += _is_optimum(result, scene, edges, std)
            beyond += _reaches_behind(scene)
        print(
            f"  {field} degrees: error / bound {rms(ratios):.3f}, coverage "
            f"{100 * covered.mean():.1f} %, optimum reached {own_reached} of {SCENES}"
        )
        every_ratio.append(ratios)
        every_covered.append(covered)
        reached += own_reached
    print(f"  {beyond} of {SCENES * len(FIELDS)} scenes have a corner beyond 90 degrees")
    ratio, coverage = rms(np.array(every_ratio)), float(np.mean(every_covered))
    total = SCENES * len(FIELDS)
    cost = _cost()
    scenes = f"{len(FIELDS)} fields of view x {SCENES} scenes"
    return [
        Row(
            f"{scenes}: same optimum as from a start at the truth",
            f"{reached} of {total}",
            f"{total}",
            reached == total,
        ),
        bound_row(scenes, ratio, MAX_OVER_BOUND),
        coverage_row(scenes, coverage, COVERAGE),
        Row(
            f"{SCENES} scenes: time of a fit of `fisheye` / time of a fit of `radial2`",
            f"{cost:.2f}",
            f"<= {MAX_COST}",
            cost <= MAX_COST,
        ),
    ]


def camera_of(scene: simulate.Scene) -> ts.Camera:
    """Return the true fisheye as a `Camera`."""
    truth = scene.camera
    return ts.Camera(truth.K, truth.distortion, truth.image_size, "fisheye")


def values(camera: ts.Camera) -> Array:
    """Return the parameters of `NAMES`."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def _edges(scene: simulate.Scene, rng: np.random.Generator) -> list[ts.PlaneEdges]:
    points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    return [ts.PlaneEdges.square(sides) for sides in points]


def _is_optimum(
    result: ts.Calibration, scene: simulate.Scene, edges: list[ts.PlaneEdges], std: Array
) -> bool:
    """Return whether the cost is at most that at the truth, and the result is near the truth."""
    # With the camera held at the truth, the rms is that at the start of a search from there. The
    # optimum of that search would be lower by the effect of eight free parameters.
    fix = ("focal", "principal_point", "distortion")
    held = ts.calibrate_edges(
        edges, scene.camera.image_size, model="fisheye", fix=fix, initial=camera_of(scene)
    )
    away = np.abs(values(result.camera) - values(camera_of(scene))) / std
    return bool(result.rms <= held.rms * (1.0 + SAME) and away.max() < 6.0)


def _reaches_behind(scene: simulate.Scene) -> bool:
    corners = (target.to_camera(target.outlines()[0]) for target in scene.targets)
    return any(bool((points[:, 2] < 0.0).any()) for points in corners)


def _cost() -> float:
    """Return the ratio of the times of two calibrations, alternated."""
    times = {"fisheye": 0.0, "radial2": 0.0}
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, 1, number])
        scenes = {
            "fisheye": simulate.wide_scene(rng, simulate.fisheye(130.0)),
            "radial2": simulate.random_scene(rng),
        }
        for model, scene in scenes.items():
            edges = _edges(scene, rng)
            start = time.perf_counter()
            ts.calibrate_edges(edges, scene.camera.image_size, model=model)
            times[model] += time.perf_counter() - start
    return times["fisheye"] / times["radial2"]
