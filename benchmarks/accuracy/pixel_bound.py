"""Pictures of three squares: error relative to the Cramer-Rao bound of the edge pixels.

`calibrate` fits the camera to the pixels; the second row is from the edge samples only. The tone
curve is linear, because the bound assumes the same contrast and noise for dark and light.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row
from harness.truth import NAMES, PINHOLE, by_name, errors, rms, rms_per_parameter

import trisquare as ts
from trisquare import simulate

SCENES = 60
SEED = 2
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
CONTRAST = 175.0  # grey levels
PIXELS_TARGET = 1.00
EDGES_TARGET = 1.25


def measure() -> list[Row]:
    """Print error / bound with the fit to the pixels, and from the edge samples only."""
    whole, edges_alone = np.zeros((2, SCENES, len(NAMES)))
    stages = set()
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng)
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(
            scene, rng, noise=noise, blur=blur, contrast=CONTRAST, tone="linear"
        )
        sigma = simulate.pixel_sigma(noise, CONTRAST, blur)
        bound = by_name(simulate.cramer_rao_bound(scene, sigma))
        result = ts.calibrate(picture, tone="linear")
        stages.add(result.stage)
        from_edges = ts.calibrate_edges(ts.detect(picture, tone="linear"), scene.camera.image_size)
        whole[seed] = errors(result, scene.camera) / bound
        edges_alone[seed] = errors(from_edges, scene.camera) / bound
    print(f"  whole pipeline (stage {', '.join(sorted(stages))}): {rms_per_parameter(whole)}")
    print(f"  edge samples alone: {rms_per_parameter(edges_alone)}")
    return [
        _row("`calibrate`", whole, PIXELS_TARGET),
        _row("`detect` and `calibrate_edges`", edges_alone, EDGES_TARGET),
    ]


def _row(name: str, ratios: np.ndarray, target: float) -> Row:
    ratio = rms(ratios[:, : len(PINHOLE)])
    name = f"{SCENES} pictures, {name}: error / Cramer-Rao bound"
    return Row(name, f"{ratio:.2f}", f"<= {target:.2f}", ratio <= target)
