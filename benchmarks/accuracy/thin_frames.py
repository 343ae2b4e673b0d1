"""Frames with thin bars, whose two edges are blurred into each other: error and refusals.

The bars are 4 to 13 px wide. The parameters are fx, fy, cx and cy. Silently wrong: one of them is
off by more than 4 std, and there is no warning above low severity.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row
from harness.truth import PINHOLE, errors

import trisquare as ts
from trisquare import simulate

SCENES = 20
SEED = 9
INNER = (0.93, 0.95, 0.965)
"""Sides of the holes over those of the frames: bars of 4 to 13 pixels."""

BLURS = (0.6, 1.2)  # pixels
SIGMAS = 4.0
TARGET = 1.3


def measure() -> list[Row]:
    """Return a row for each width of the bars."""
    return [_row(inner) for inner in INNER]


def _row(inner: float) -> Row:
    ratios, focal, refused, silent = [], [], 0, 0
    for scene_seed in range(SCENES):
        rng = np.random.default_rng([SEED, scene_seed])
        scene = simulate.random_scene(rng, kind="frame", inner=inner)
        noise, blur = rng.uniform(1.0, 3.0), rng.uniform(*BLURS)
        picture = simulate.render(scene, rng, noise=noise, blur=blur, tone="srgb")
        try:
            result = ts.calibrate(picture)
        except ts.TrisquareError as refusal:
            refused += 1
            print(f"  hole {inner:g}, scene {scene_seed}: {type(refusal).__name__}: {refusal}")
            continue
        off = errors(result, scene.camera)[: len(PINHOLE)]
        ratio = off / [result.std[name] for name in PINHOLE]
        is_warned = any(warning.severity != "low" for warning in result.warnings)
        silent += not is_warned and bool(np.abs(ratio).max() > SIGMAS)
        ratios.append(ratio)
        focal.append(abs(off[0]) / scene.camera.fx)
        print(f"  hole {inner:g}, scene {scene_seed}, blur {blur:.2f} px: {np.round(ratio, 1)}")
    worst = float(np.sqrt(np.mean(np.square(ratios), axis=0)).max())
    return Row(
        f"hole {inner:g} of the side, {SCENES} pictures: error / std, rms, worst parameter; median "
        "error of fx; refused; silently wrong",
        f"{worst:.2f}; {100 * np.median(focal):.4f} %; {refused}; {silent}",
        f"<= {TARGET}; -; -; 0",
        worst <= TARGET and silent == 0,
    )
