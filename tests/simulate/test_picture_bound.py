"""The bound from a picture: the classic one where that holds, a higher one elsewhere."""

import numpy as np
import pytest

from trisquare import simulate
from trisquare_scenes.picture_bound import picture_bound

NOISE, BLUR, CONTRAST = 2.0, 0.8, 150.0


def ideal_of(scene, **changes):
    settings = {"noise": 0.0, "blur": BLUR, "contrast": CONTRAST, "dtype": np.float32, **changes}
    return 255.0 * simulate.render(scene, np.random.default_rng(0), **settings)


def bounds(scene, ideal, wrong):
    """The bound from the picture over that for separate edges in white noise."""
    own = picture_bound(scene, ideal, wrong.astype(np.float32), BLUR)
    classic = simulate.cramer_rao_bound(scene, simulate.pixel_sigma(NOISE, CONTRAST, BLUR))
    return np.array([own[name] / classic[name] for name in classic])


@pytest.fixture(scope="module")
def squares():
    rng = np.random.default_rng(91)
    scene = simulate.random_scene(rng, image_size=(640, 480))
    return scene, ideal_of(scene), NOISE * rng.standard_normal((480, 640))


def test_squares_in_white_noise_have_the_classic_bound(squares):
    # The spread estimated from the blocks' errors is itself uncertain by some per cent.
    ratios = bounds(*squares)
    np.testing.assert_allclose(ratios, 1.0, atol=0.25)
    assert ratios.mean() == pytest.approx(1.0, abs=0.1)


def test_errors_that_hang_together_raise_it(squares):
    scene, ideal, _ = squares
    rng = np.random.default_rng(92)
    in_blocks = NOISE * np.kron(rng.standard_normal((60, 80)), np.ones((8, 8)))
    # An edge through a block has one error, equal for the light on both sides, so that only the
    # asymmetric part counts.
    along = NOISE * np.kron(rng.standard_normal((60, 640)), np.ones((8, 1)))
    white = NOISE * rng.standard_normal((480, 640))
    usual = bounds(scene, ideal, white)
    assert (bounds(scene, ideal, along) > 1.3 * usual).all()
    assert (bounds(scene, ideal, in_blocks) > 1.3 * usual).all()


def test_light_that_falls_off_raises_it(squares):
    scene, ideal, wrong = squares
    dim = bounds(scene, ideal_of(scene, shading=0.6), wrong)
    assert (dim > 1.1 * bounds(scene, ideal, wrong)).all()


def test_a_frame_s_hole_has_a_size_of_its_own():
    rng = np.random.default_rng(93)
    scene = simulate.random_scene(rng, image_size=(640, 480), kind="frame")
    wrong = NOISE * rng.standard_normal((480, 640))
    assert bounds(scene, ideal_of(scene), wrong).mean() == pytest.approx(1.0, abs=0.2)
