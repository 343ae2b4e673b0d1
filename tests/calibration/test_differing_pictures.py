"""Pictures of two cameras that each determine their own."""

import numpy as np
import pytest

import trisquare as ts
from trisquare.simulate import random_camera
from trisquare_scenes.broken_assumptions import zoomed_pictures


def two_pictures(seed: int, zoom: float) -> list[np.ndarray]:
    rng = np.random.default_rng([1616, seed])
    return zoomed_pictures(rng, random_camera(rng), zoom)


@pytest.mark.parametrize("seed", range(4))
def test_a_small_zoom_between_two_pictures_is_named(seed: int) -> None:
    pictures = two_pictures(seed, 1.008)
    warning = ts.calibrate(pictures).warnings[0]
    assert (warning.code, warning.severity) == ("pictures_disagree", "high")
    assert "picture 1 has f" in warning
    assert "picture 0 " in warning
    for picture in pictures:
        assert not any(own.code == "pictures_disagree" for own in ts.calibrate(picture).warnings)


@pytest.mark.parametrize("seed", range(4))
def test_pictures_of_one_camera_do_not_disagree(seed: int) -> None:
    result = ts.calibrate(two_pictures(seed, 1.0))
    assert not any(warning.code == "pictures_disagree" for warning in result.warnings)


def test_the_pictures_that_differ_from_most_are_named() -> None:
    one, other = two_pictures(7, 1.02)
    third, _ = two_pictures(7, 1.0)
    noise = np.random.default_rng(1).normal(0.0, 1.0, third.shape)
    again = np.clip(np.round(third + noise), 0, 255).astype(np.uint8)
    result = ts.calibrate([one, other, again])
    assert result.warnings[0].code == "pictures_disagree"
    assert "calibrated alone, picture 1 has f" in result.warnings[0]
    assert "also not of the camera" not in result.warnings[0]


def test_all_pictures_of_another_camera_are_named() -> None:
    one, other = two_pictures(7, 1.02)
    _, third = two_pictures(8, 1.0)
    text = ts.calibrate([one, other, third]).warnings[0]
    assert text.code == "pictures_disagree"
    assert "(also not of the camera of picture " in text
