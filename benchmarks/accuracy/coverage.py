"""Coverage of the 95 % intervals, from edge points and from pictures.

Coverage is the fraction of the stated intervals of fx, fy, cx, cy, k1 and k2 that contain the
truth. The noise of edge points is white, unless the row says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from accuracy.disturbed_edges import (
    Errors,
    bowed,
    correlated,
    displaced,
    disturbed_edges,
    rough,
    white,
)
from harness.rows import Row
from harness.truth import NAMES, Array, by_name, errors, rms_per_parameter

import trisquare as ts
from trisquare import simulate

EDGE_TRIALS = 1000
DISTURBED_TRIALS = 150
PICTURE_TRIALS = 200
JPEG_TRIALS = 60
SEED = 40
NOISE_RANGE = (0.05, 0.5)  # pixels
SPACING = 4.0  # pixels of edge per sample
PIXEL_NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
CONTRAST_RANGE = (120.0, 190.0)  # grey levels
SHADING_RANGE = (0.0, 0.3)
TONES = ("linear", "srgb", 1.8, 2.2)
FRAMES_EVERY = 3
JPEG_QUALITY = 85
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964
EDGES_TARGET = (0.94, 0.96)
PICTURES_TARGET = (0.92, 0.97)

Trial = Callable[[np.random.Generator], Array]
"""Function that draws a scene and returns the errors of its calibration in stated standard
deviations."""


def edge_trial(kind: Errors) -> Trial:
    """Return the trial of edge points with errors of one kind."""

    def trial(rng: np.random.Generator) -> Array:
        scene = simulate.random_scene(rng)
        noise = rng.uniform(*NOISE_RANGE)
        edges = disturbed_edges(scene, rng, kind, noise, SPACING)
        result = ts.calibrate_edges(edges, scene.camera.image_size)
        return errors(result, scene.camera) / by_name(result.std)

    return trial


def picture_trial(*, tone_known: bool, jpeg_quality: int | None = None) -> Trial:
    """Return the trial of a rendered picture with a known or an estimated tone curve."""

    def trial(rng: np.random.Generator) -> Array:
        scene = simulate.random_scene(
            rng, kind="frame" if rng.integers(FRAMES_EVERY) == 0 else "square"
        )
        tone = TONES[rng.integers(len(TONES))]
        picture = simulate.render(
            scene,
            rng,
            noise=rng.uniform(*PIXEL_NOISE_RANGE),
            blur=rng.uniform(*BLUR_RANGE),
            contrast=rng.uniform(*CONTRAST_RANGE),
            shading=rng.uniform(*SHADING_RANGE),
            tone=tone,
            jpeg_quality=jpeg_quality,
        )
        result = ts.calibrate(picture, tone=tone if tone_known else "auto")
        return errors(result, scene.camera) / by_name(result.std)

    return trial


def coverage(name: str, trial: Trial, trials: int) -> float:
    """Print the coverage of each parameter's interval, and return the pooled coverage.

    Refused scenes have no interval; they are printed.
    """
    deviations = []
    refusals: list[str] = []
    for seed in range(trials):
        try:
            deviations.append(trial(np.random.default_rng([SEED, seed])))
        except ts.TrisquareError as error:
            refusals.append(f"{seed}: {error}")
    z = np.array(deviations)
    covered = np.abs(z) <= HALF_WIDTH
    shares = ", ".join(
        f"{name} {share:.1%}" for name, share in zip(NAMES, covered.mean(axis=0), strict=True)
    )
    print(f"  {name}, {len(z)} scenes: {covered.mean():.1%} ({shares})")
    print(f"    rms error in stated std: {rms_per_parameter(z)}", flush=True)
    for refusal in refusals:
        print(f"    refused {refusal}")
    return float(covered.mean())


def measure() -> list[Row]:
    """Return the coverages for errors of every kind; only those for white noise have targets."""
    jpeg = f"pictures, JPEG {JPEG_QUALITY}"
    kinds = (
        ("edge points", edge_trial(white), EDGE_TRIALS, EDGES_TARGET),
        ("pictures", picture_trial(tone_known=True), PICTURE_TRIALS, PICTURES_TARGET),
        (
            "pictures, tone curve estimated",
            picture_trial(tone_known=False),
            PICTURE_TRIALS,
            None,
        ),
        (jpeg, picture_trial(tone_known=True, jpeg_quality=JPEG_QUALITY), JPEG_TRIALS, None),
        (
            f"{jpeg}, tone curve estimated",
            picture_trial(tone_known=False, jpeg_quality=JPEG_QUALITY),
            JPEG_TRIALS,
            None,
        ),
        (
            "edge points, sides displaced by as much as the noise",
            edge_trial(displaced),
            DISTURBED_TRIALS,
            None,
        ),
        (
            "edge points, sides bowed by as much as the noise",
            edge_trial(bowed),
            DISTURBED_TRIALS,
            None,
        ),
        (
            "edge points, correlation 0.3 of neighbouring samples",
            edge_trial(correlated),
            DISTURBED_TRIALS,
            None,
        ),
        (
            "edge points, noise of one plane five times as large",
            edge_trial(rough),
            DISTURBED_TRIALS,
            None,
        ),
    )
    return [
        _row(f"{name}, {trials} scenes: coverage of the 95 % intervals", share, target)
        for name, trial, trials, target in kinds
        for share in [coverage(name, trial, trials)]
    ]


def _row(name: str, share: float, target: tuple[float, float] | None) -> Row:
    if target is None:
        return Row(name, f"{share:.1%}", "", None)
    low, high = target
    return Row(name, f"{share:.1%}", f"{low:.0%}-{high:.0%}", low <= share <= high)
