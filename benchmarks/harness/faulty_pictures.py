"""Calibrations of pictures with a fault."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene
from trisquare_scenes.picture_faults import PictureFault, photograph


def calibrated(
    fault: PictureFault, count: int, seed: int, *, noise: float, blur: float
) -> Iterator[tuple[Scene, ts.Calibration]]:
    """Yield `count` scenes of three squares or frames, and the calibrations of their pictures."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        scene = simulate.random_scene(rng, kind="frame" if number % 2 else "square")
        yield scene, ts.calibrate(photograph(scene, rng, fault, noise=noise, blur=blur))
