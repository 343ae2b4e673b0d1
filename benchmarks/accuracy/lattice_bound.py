"""Pictures of three chessboards: error relative to the Cramer-Rao bound of the pixels.

The bound is that of all pixels along the grid lines.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from harness.rows import Row
from harness.truth import PINHOLE, by_name, errors, rms, rms_per_parameter

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene

SCENES = 40
SEED = 21
BOARDS = (5, 7, 9, 15)  # inner corners a side; cells of some 50 to 19 pixels
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 2.0)  # pixels
CONTRAST = 175.0  # grey levels
TARGET = 1.30


def measure() -> list[Row]:
    """Print error / bound and error / stated standard deviation for boards of several sizes."""
    ratios, scores = [], []
    refused = 0
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, seed])
        scene = board_scene(rng, BOARDS[seed % len(BOARDS)])
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(
            scene, rng, noise=noise, blur=blur, contrast=CONTRAST, tone="linear"
        )
        sigma = simulate.pixel_sigma(noise, CONTRAST, blur)
        bound = by_name(simulate.cramer_rao_bound(scene, sigma))
        try:
            result = ts.calibrate(picture, tone="linear")
        except ts.TrisquareError as error:
            print(f"  seed {seed}: {error}")
            refused += 1
            continue
        ratios.append(errors(result, scene.camera) / bound)
        scores.append(errors(result, scene.camera) / by_name(result.std))
    print(f"  error / bound: {rms_per_parameter(np.array(ratios))}")
    print(f"  error / stated deviation: {rms_per_parameter(np.array(scores))}")
    ratio = rms(np.array(ratios)[:, : len(PINHOLE)])
    return [
        Row(
            f"{SCENES} pictures: error / Cramer-Rao bound",
            f"{ratio:.2f} ({refused} refused)",
            f"<= {TARGET:.2f}",
            ratio <= TARGET and not refused,
        )
    ]


def board_scene(
    rng: np.random.Generator, inner_corners: int, image_size: tuple[int, int] = (1280, 960)
) -> Scene:
    """Draw a scene of three squares, each a chessboard."""
    scene = simulate.random_scene(rng, image_size=image_size)
    boards = tuple(
        replace(
            target,
            translation=(inner_corners + 1) * target.translation,
            kind="chessboard",
            inner_corners=(inner_corners, inner_corners),
        )
        for target in scene.targets
    )
    return replace(scene, targets=boards)
