"""Wide lenses of `rational` and `brown`: error and residuals.

From edge points of three boards that do not reach the corners of the picture. Wrong: any of fx, fy,
cx and cy is off by more than 4 std; silently: without a warning of high severity.
"""

from __future__ import annotations

import numpy as np
from accuracy.lens_beyond_model import (
    SIZE,
    Lens,
    boards_of,
    brown,
    draw_heights,
    is_monotonic,
)
from harness.rows import Row
from harness.truth import PINHOLE

import trisquare as ts

SCENES = 60
SEED = 61
BOARDS = 3
NOISE = 0.05  # pixels
WRONG_STDS = 4.0
LARGEST_RATIO = 1.2  # of errors to stated standard deviations, root mean square
MAX_LEFT = 1.1  # maximum residuals, relative to the noise


def measure() -> list[Row]:
    """Count answers with a focal length or principal point beyond 4 stated standard deviations."""
    rows = []
    for model in ("rational", "brown"):
        deviations, left, silent, refused = [], [], 0, 0
        for number in range(SCENES):
            rng = np.random.default_rng([SEED, number])
            lens = _lens(rng, model)
            boards = boards_of(rng, lens, draw_heights(rng, "flat"), NOISE, BOARDS)
            try:
                result = ts.calibrate_edges(boards, SIZE, model=model)
            except ts.TrisquareError:
                refused += 1
                continue
            left.append(result.rms / NOISE)
            truth = np.concatenate([lens.focal, lens.centre])
            errors = np.array([getattr(result.camera, name) for name in PINHOLE]) - truth
            deviations.append(errors / [result.std[name] for name in PINHOLE])
            is_warned = any(warning.severity == "high" for warning in result.warnings)
            silent += bool(np.abs(deviations[-1]).max() > WRONG_STDS and not is_warned)
        rms = float(np.sqrt(np.mean(np.square(deviations))))
        wrong = int((np.abs(deviations).max(axis=1) > WRONG_STDS).sum())
        name = f"{SCENES} lenses, `{model}`"
        rows += [
            Row(f"{name}: refused", f"{refused}", "", None),
            Row(
                f"{name}: wrong; silently wrong",
                f"{wrong}; {silent}",
                "0; 0",
                wrong == 0,
            ),
            Row(
                f"{name}: error / std, rms",
                f"{rms:.2f}",
                f"<= {LARGEST_RATIO}",
                rms <= LARGEST_RATIO,
            ),
            Row(
                f"{name}: rms residual / noise, largest of a lens",
                f"{max(left):.2f}",
                f"<= {MAX_LEFT}",
                max(left) <= MAX_LEFT,
            ),
        ]
    return rows


def _lens(rng: np.random.Generator, model: str) -> Lens:
    """Draw a wide lens whose distortion does not fold back inside the picture."""
    while True:
        focal = SIZE[0] * rng.uniform(0.42, 0.52) * np.array([1.0, rng.uniform(0.998, 1.002)])
        centre = rng.normal(np.array(SIZE) / 2, 0.01 * SIZE[0])
        c = np.zeros(8)
        c[2:4] = rng.normal(0.0, 0.0004, 2)
        if model == "rational":
            c[5:8] = rng.uniform([0.4, 0.05, 0.0], [0.9, 0.2, 0.02])
            c[:2] = c[5] + rng.uniform(-0.35, -0.25), rng.uniform(0.0, 0.1)
        else:
            c[[0, 1, 4]] = rng.uniform([-0.3, 0.04, -0.03], [-0.15, 0.12, -0.003])
        lens = Lens(focal, centre, brown(c))
        if is_monotonic(lens):
            return lens
