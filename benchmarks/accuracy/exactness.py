"""Noise-free edge points: error of the linear and of the maximum-likelihood method.

Errors of fx, fy, cx and cy are relative, those of the coefficients of distortion absolute. The lens
models are `none` to `brown`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate
from trisquare.camera.camera import camera_parameters
from trisquare.camera.lens_models import BROWN, COEFFICIENTS
from trisquare.simulate.scene import TrueCamera

# Fisheyes and richer lenses have benchmarks of their own.
MODELS = [model for model, coefficients in COEFFICIENTS.items() if coefficients == BROWN]
SCENES = 40
SEED = 4
EXACT = 1e-8  # relative for lengths, absolute for the distortion's pure numbers


def measure() -> list[Row]:
    """Print the worst error of either method over the scenes."""
    linear = [_error(seed, "none", "none", "linear") for seed in range(SCENES)]
    # The distortion is free here and must be estimated as zero.
    freed = [_error(seed, "none", "radial2", "linear") for seed in range(SCENES)]
    refined = {
        model: max(_error(seed, model, model, "ml") for seed in range(SCENES)) for model in MODELS
    }
    print(f"  linear: model none {max(linear):.1e}, radial2 {max(freed):.1e}")
    print("  ml:", ", ".join(f"{model} {error:.1e}" for model, error in refined.items()))
    return [
        _row("`linear`, lens without distortion", max(linear + freed)),
        _row("`ml`, lens of the fitted model", max(refined.values())),
    ]


def _row(name: str, worst: float) -> Row:
    name = f"{name}, {SCENES} scenes: largest error"
    return Row(name, f"{worst:.1e}", f"{EXACT:.0e}", worst <= EXACT)


def _error(seed: int, true_model: str, model: str, method: str) -> float:
    """Return the error of the worst parameter."""
    rng = np.random.default_rng([SEED, seed])
    scene = simulate.random_scene(rng, camera=_camera(rng, true_model))
    edges = [ts.PlaneEdges.square(sides) for sides in simulate.edge_points(scene, rng, noise=0.0)]
    size = scene.camera.image_size
    found = ts.calibrate_edges(edges, size, method=method, model=model).camera
    truth = camera_parameters(ts.Camera(scene.camera.K, scene.camera.distortion, size))
    return max(
        abs(value - truth[name]) / (abs(truth[name]) if name[0] in "fc" else 1.0)
        for name, value in camera_parameters(found).items()
    )


def _camera(rng: np.random.Generator, model: str) -> TrueCamera:
    """Draw a camera of the usual distribution whose distortion is of the given model."""
    while True:
        camera = simulate.random_camera(rng)
        k1, k2 = camera.distortion[:2]
        distortion = {
            "none": [0.0, 0.0, 0.0, 0.0, 0.0],
            "radial1": [k1, 0.0, 0.0, 0.0, 0.0],
            "radial2": [k1, k2, 0.0, 0.0, 0.0],
            "radial3": [k1, k2, 0.0, 0.0, 0.02 * rng.standard_normal()],
            "brown": [k1, k2, *(0.001 * rng.standard_normal(2)), 0.02 * rng.standard_normal()],
        }[model]
        camera = replace(camera, distortion=np.array(distortion))
        if camera.is_monotonic():
            return camera
