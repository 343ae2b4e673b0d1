"""A soft shadow across one of three squares."""

import numpy as np
import pytest

import trisquare as ts
from trisquare.simulate import random_scene, render
from trisquare.simulate.render import decode_tone, encode_tone

DEPTH = 0.4
SOFTNESS = 8.0  # pixels


def rise(distance: np.ndarray, softness: float) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * distance / softness)


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_a_shadow_on_one_square_leaves_the_tone_curve_known(seed: int) -> None:
    """The sides that it crosses contradict the others, and do not count."""
    rng = np.random.default_rng([1717, seed])
    scene = random_scene(rng, kind="square")
    image = render(scene, rng, noise=1.0, blur=0.8, tone="srgb")
    corners = scene.image_points(0, scene.targets[0].outlines()[0])
    centre, side = corners.mean(axis=0), np.linalg.norm(corners[1] - corners[0])
    angle = rng.uniform(0.0, np.pi)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    across = (x - centre[0]) * np.cos(angle) + (y - centre[1]) * np.sin(angle)
    is_near = rise(0.75 * side - np.hypot(x - centre[0], y - centre[1]), 0.05 * side)
    shade = is_near * rise(0.15 * side - np.abs(across), SOFTNESS)
    light = decode_tone(image / 255.0, "srgb") * (1.0 - DEPTH * shade)
    shadowed = 255.0 * encode_tone(light, "srgb")
    result = ts.calibrate(np.round(shadowed).astype(np.uint8))
    assert not any(warning.code == "no_tone_curve" for warning in result.warnings)
    assert result.std["fx"] < 1e-3 * scene.camera.fx
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"]
