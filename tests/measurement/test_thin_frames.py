"""Frames so thin that both edges of a bar are blurred into each other."""

import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate

NAMES = ("fx", "fy", "cx", "cy")


def thin_frames(seed, *, inner, blur):
    rng = np.random.default_rng(seed)
    scene = simulate.random_scene(rng, kind="frame", inner=inner)
    return scene, simulate.render(scene, rng, noise=2.0, blur=blur, tone="srgb")


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_the_far_edge_of_a_bar_does_not_move_the_near_one(seed):
    """With bars of 4 to 8 px, the edges used to be 0.005 to 0.1 px off."""
    scene, picture = thin_frames(seed, inner=0.95, blur=0.7)
    result = ts.calibrate(picture)
    assert len(result.planes) == 3
    for name in NAMES:
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < 3.0 * result.std[name]
    assert abs(result.camera.fx / scene.camera.fx - 1.0) < 1e-3


def test_bars_of_few_blurs_are_refused():
    _, picture = thin_frames(1, inner=0.975, blur=1.5)
    with pytest.raises(ts.TrisquareError, match="something else is too close to it"):
        ts.calibrate(picture)
