"""Scenes with known truth, their edges, and limits on the errors of a result."""

import cv2
import numpy as np

from trisquare import Camera, PlaneEdges, simulate
from trisquare.camera.camera import camera_parameters

IMAGE_SIZE = (1280, 960)
PLACES = np.array([[0.23, 0.3], [0.77, 0.3], [0.5, 0.72]])


def squares(seed, camera=None, count=3, kind="square", **options):
    rng = np.random.default_rng(seed)
    return simulate.random_scene(rng, camera=camera, count=count, kind=kind, **options)


def parallel_squares(camera, tilt=(0.5, 0.3, 0.2), side=350.0):
    """Three squares with the same orientation."""
    rotation = cv2.Rodrigues(np.array(tilt))[0]
    rays = np.column_stack([camera.undistort(PLACES * camera.image_size), np.ones(3)])
    targets = [simulate.Target(rotation, ray * camera.fx / side) for ray in rays]
    return simulate.Scene(camera, tuple(targets))


def edges_of(scene, noise=0.0, seed=0, spacing=4.0, tied=True):
    """The figures of a scene: one per square, two per frame, on one plane if `tied`."""
    sides = simulate.edge_points(scene, np.random.default_rng(seed), noise=noise, spacing=spacing)
    return [
        PlaneEdges.square(
            outlines[start : start + 4],
            plane=number if tied else None,
            freedom="size" if start else "auto",
        )
        for number, outlines in enumerate(sides)
        for start in range(0, len(outlines), 4)
    ]


def camera_of(scene):
    """The scene's camera as a `Camera` of the package."""
    truth = scene.camera
    return Camera(truth.K, truth.distortion, truth.image_size, "brown")


def errors_in_std(result, scene):
    truth = camera_parameters(camera_of(scene))
    found = camera_parameters(result.camera)
    return {name: (found[name] - truth[name]) / result.std[name] for name in result.std}


def assert_within(result, scene, sigmas):
    errors = errors_in_std(result, scene)
    assert all(abs(error) < sigmas for error in errors.values()), errors


def assert_exact(camera, scene, relative=1e-8):
    truth = scene.camera
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(camera, name) - getattr(truth, name)) < relative * truth.fx, name
