"""Pictures with a skew of 3 px that is fixed at 0: warnings, and errors without a warning.

From edge points. The warnings are `pixels_not_square` and `planes_contradict`; the errors are those
of fx, fy, cx and cy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from accuracy.planned_scenes import edges_of
from harness.rows import Row
from harness.truth import PINHOLE, errors

import trisquare as ts
from trisquare import simulate

SCENES = 60
SEED = 17
SKEW, NOISE = 3.0, 0.1  # pixels
FAR_STDS = 3.0
CODES = {"planes_contradict", "pixels_not_square"}


def measure() -> list[Row]:
    """Count the results with a warning of the skew, and the large errors of the others."""
    rows = []
    for count, name in ((3, "three"), (4, "four")):
        warned, off = _outcomes(count)
        silent = off[~warned]
        of_fx, of_any = silent[:, 0], silent.max(axis=1)
        scenes = f"{name} squares, {SCENES} scenes"
        rows += [
            Row(f"{scenes}: warned", f"{warned.sum()}", "", None),
            Row(
                f"{scenes}, not warned: an error beyond {FAR_STDS:g} std; largest error / std, "
                "of all and of fx",
                f"{(of_any > FAR_STDS).sum()}; {of_any.max():.1f}, {of_fx.max():.1f}",
                "",
                None,
            ),
        ]
    return rows


def _outcomes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return by scene whether there is such a warning, and the errors in stds."""
    warned, off = [], []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        camera = replace(simulate.random_camera(rng), skew=SKEW)
        scene = simulate.random_scene(rng, camera=camera, count=count)
        result = ts.calibrate_edges(edges_of(scene, rng, NOISE), camera.image_size)
        stds = np.array([result.std[name] for name in PINHOLE])
        warned.append(any(warning.code in CODES for warning in result.warnings))
        off.append(np.abs(errors(result, camera)[: len(PINHOLE)] / stds))
    return np.array(warned), np.array(off)
