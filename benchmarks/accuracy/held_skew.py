"""Sheared pictures whose skew is held at zero: which say so, and how far the others are off."""

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
TOLD = {"planes_contradict", "pixels_not_square"}


def measure() -> list[Row]:
    """Count the answers with a warning of contradicting planes, and wrong answers without."""
    rows = []
    for count, name in ((3, "three"), (4, "four")):
        told, off = _outcomes(count)
        silent = off[~told]
        of_fx, of_any = silent[:, 0], silent.max(axis=1)
        scenes = f"{name} squares from edges, skew {SKEW:g} px held at 0, {SCENES} scenes"
        rows += [
            Row(f"{scenes}: `{'` or `'.join(sorted(TOLD))}`", f"{told.sum()}", "", None),
            Row(
                f"the same, without them: any of {', '.join(PINHOLE)} beyond {FAR_STDS:g} standard "
                "deviations; the largest; the largest of fx",
                f"{(of_any > FAR_STDS).sum()}; {of_any.max():.1f}; {of_fx.max():.1f}",
                "",
                None,
            ),
        ]
    return rows


def _outcomes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return by scene whether planes contradict each other, and the errors in stds."""
    told, off = [], []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        camera = replace(simulate.random_camera(rng), skew=SKEW)
        scene = simulate.random_scene(rng, camera=camera, count=count)
        result = ts.calibrate_edges(edges_of(scene, rng, NOISE), camera.image_size)
        stds = np.array([result.std[name] for name in PINHOLE])
        told.append(any(warning.code in TOLD for warning in result.warnings))
        off.append(np.abs(errors(result, camera)[: len(PINHOLE)] / stds))
    return np.array(told), np.array(off)
