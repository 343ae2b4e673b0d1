"""Time of estimating the lens model and the tone curve."""

from __future__ import annotations

import cv2
import numpy as np
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image

PICTURES = 4
REPETITIONS = 9
SEED = 41
# Choices, and the maximum ratio of their time to that with a stated radial2 and a stated curve.
CHOICES = (
    ('`model="auto"`', {"model": "auto", "tone": "srgb"}, 1.5),
    ('`tone="auto"` (default for 8 bits)', {"tone": "auto"}, 1.2),
    ("both", {"model": "auto", "tone": "auto"}, 1.7),
)


def measure() -> list[Row]:
    """Print the ratios of the times, medians over the pictures."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times = [_times(_picture(np.random.default_rng([SEED, i]))) for i in range(PICTURES)]
    finally:
        cv2.setNumThreads(threads)
    ratios = np.median([np.array(own[1:]) / own[0] for own in times], axis=0)
    return [
        Row(
            f"{name}: time / time with both stated",
            f"{ratio:.2f}",
            f"<= {target}",
            bool(ratio <= target),
        )
        for (name, _, target), ratio in zip(CHOICES, ratios, strict=True)
    ]


def _times(picture: Image) -> list[float]:
    stated = {"tone": "srgb"}
    options = [stated, *(own for _, own, _ in CHOICES)]
    calibrations = [lambda own=own: ts.calibrate(picture, **own) for own in options]
    return alternated_medians(calibrations, REPETITIONS)


def _picture(rng: np.random.Generator) -> Image:
    noise, blur = rng.uniform(1.0, 4.0), rng.uniform(0.5, 1.2)
    return simulate.render(simulate.random_scene(rng), rng, noise=noise, blur=blur, tone="srgb")
