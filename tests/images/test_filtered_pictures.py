"""Pictures whose blur is symmetric but not normal: without a lens's blur, or filtered."""

import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare_scenes.picture_faults import PictureFault, defocused, filtered, photograph


def assert_as_known_as_with_srgb(found, picture, truth):
    """Assert that the camera is right, and known nearly as well as with the curve stated."""
    stated = ts.calibrate(picture, tone="srgb")
    for name in ("fx", "fy", "cx", "cy"):
        std = found.std[name]
        error = getattr(found.camera, name) - getattr(truth, name)
        assert abs(error) < 4.0 * std
        assert std < 4.0 * stated.std[name]


CASES = [(kind, blur) for kind in ("square", "frame") for blur in (None, 0.8)]


@pytest.mark.parametrize(("kind", "blur"), CASES)
def test_the_tone_curve_is_found_whatever_the_shape_of_a_symmetric_blur(kind, blur):
    rng = np.random.default_rng([431, len(kind), blur is None])
    scene = simulate.random_scene(rng, kind=kind)
    fault = PictureFault(on_light=[filtered(blur)] if blur else [])
    picture = photograph(scene, rng, fault, noise=1.0, blur=0.05)
    found = ts.calibrate(picture)
    assert "no_tone_curve" not in [warning.code for warning in found.warnings]
    assert abs(found.tone - 2.2) < 4.0 * found.tone_std
    assert_as_known_as_with_srgb(found, picture, scene.camera)


@pytest.mark.parametrize("radius", [1.2, 1.6])
def test_a_lens_out_of_focus_leaves_the_tone_curve_known(radius):
    """Fitted with a normal blur, the curve was lost, and the std of fx 3.4 to 4 times as large."""
    rng = np.random.default_rng([433, round(10 * radius)])
    scene = simulate.random_scene(rng)
    fault = PictureFault(on_light=[defocused(radius)])
    picture = photograph(scene, rng, fault, noise=0.7, blur=0.05)
    found = ts.calibrate(picture)
    assert "no_tone_curve" not in [warning.code for warning in found.warnings]
    assert_as_known_as_with_srgb(found, picture, scene.camera)
