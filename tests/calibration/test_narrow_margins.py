"""Sheets that end close to their squares: their edges do not displace those of the squares."""

from dataclasses import replace

import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate

TRUTH = {"fx": 450.0, "fy": 450.0, "cx": 322.0, "cy": 238.0}


@pytest.mark.slow
def test_a_narrow_margin_leaves_the_deviations_true():
    """In 640 x 480, margins of 8 % of the side end 5 px from the edges; the rms used to be 1.7."""
    camera = simulate.TrueCamera(*TRUTH.values(), (-0.12, 0.03, 0, 0, 0), (640, 480))
    errors = []
    for seed in range(900, 920):
        rng = np.random.default_rng(seed)
        scene = simulate.random_scene(rng, camera=camera, kind="frame")
        targets = tuple(replace(target, rim=0.08) for target in scene.targets)
        scene = simulate.Scene(scene.camera, targets)
        result = ts.calibrate(simulate.render(scene, rng, tone="srgb", clutter=5))
        if any(warning.severity == "high" for warning in result.warnings):
            continue
        errors.append(
            [(getattr(result.camera, name) - TRUTH[name]) / result.std[name] for name in TRUTH]
        )
    assert len(errors) >= 15
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
