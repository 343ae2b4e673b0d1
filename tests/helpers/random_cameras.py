"""Cameras with random numbers, and comparisons of cameras."""

import numpy as np
from camera_files import FILES

from trisquare import Camera

SIZE = (1280, 960)


MODELS = {
    "none": (),
    "radial1": (0,),
    "radial2": (0, 1),
    "radial3": (0, 1, 4),
    "brown": (0, 1, 2, 3, 4),
}


def random_camera(seed, coefficients="brown", **changes):
    """A camera with numbers of 16 digits, invertible over the whole picture."""
    rng = np.random.default_rng(seed)
    fx = rng.uniform(900, 1500)
    K = np.array([[fx, 0, rng.normal(640, 15)], [0, fx * rng.uniform(0.99, 1.01), 0], [0, 0, 1]])
    K[1, 2] = rng.normal(480, 15)
    spread = np.array([0.1, 0.03, 0.002, 0.002, 0.01])
    distortion = np.zeros(5)
    for index in MODELS[coefficients]:
        distortion[index] = spread[index] * rng.uniform(-1, 1)
    values = {"K": K, "distortion": distortion, "image_size": SIZE, "model": coefficients}
    return Camera(**{**values, **changes})


def pixel_grid(camera):
    width, height = camera.image_size
    x, y = np.linspace(0, width - 1, 15), np.linspace(0, height - 1, 11)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def saved(camera, path):
    approximation = camera.save(path, FILES[path.name])
    assert approximation is None
    return path


def assert_same(read, camera, tolerance=0.0, distortion_tolerance=0.0):
    assert read.image_size == camera.image_size
    assert np.abs(read.K - camera.K).max() <= tolerance
    assert np.abs(read.distortion - camera.distortion).max() <= distortion_tolerance


def camera_for_hugin(seed, coefficients):
    """A camera with square pixels and no coefficient except k1."""
    camera = random_camera(seed, coefficients)
    K = camera.K.copy()
    K[1, 1] = K[0, 0]
    return Camera(K, camera.distortion * [1, 0, 0, 0, 0], SIZE, coefficients)
