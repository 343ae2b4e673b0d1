"""Small tangential distortion: wrong results with `radial2` and with `auto`.

Three squares from edge points. Wrong: any of fx, fy, cx and cy is off by more than 4 std; silently:
without a warning above low severity.
"""

from __future__ import annotations

import numpy as np
from accuracy.planned_scenes import edges_of
from harness.rows import Row
from harness.truth import PINHOLE, errors

import trisquare as ts
from trisquare import simulate

SCENES = 60
SEED = 5
DECENTRED = ((0.0006, -0.0004), (0.0012, -0.0008))  # p1, p2
NOISE = 0.05  # pixels
WRONG_STDS = 4.0


def measure() -> list[Row]:
    """Count answers with a parameter off by more than 4 stated standard deviations."""
    rows = []
    for p1, p2 in DECENTRED:
        name = f"p1 {p1:g}, p2 {p2:g}, {SCENES} scenes"
        wrong, silent = _wrong(p1, p2, "radial2")
        rows.append(
            Row(
                f"{name}, `radial2`: wrong; silently wrong",
                f"{wrong}; {silent}",
                "",
                None,
            )
        )
        wrong, silent = _wrong(p1, p2, "auto")
        row = f"{name}, `auto`: wrong; silently wrong"
        rows.append(Row(row, f"{wrong}; {silent}", "0; 0", wrong == 0))
    return rows


def _wrong(p1: float, p2: float, model: str) -> tuple[int, int]:
    """Count the wrong answers, and those among them without a warning above low severity."""
    wrong = silent = 0
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        lens = np.array([-0.2, 0.05, p1, p2, 0.0])
        camera = simulate.TrueCamera(900.0, 900.0, 645.0, 475.0, lens, image_size=(1280, 960))
        scene = simulate.random_scene(rng, camera=camera)
        result = ts.calibrate_edges(edges_of(scene, rng, NOISE), camera.image_size, model=model)
        stds = np.array([result.std[name] for name in PINHOLE])
        if np.abs(errors(result, camera)[: len(PINHOLE)] / stds).max() > WRONG_STDS:
            wrong += 1
            silent += all(warning.severity == "low" for warning in result.warnings)
    return wrong, silent
