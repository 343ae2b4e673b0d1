"""Scenes outside the usual distribution: planes of similar directions, small squares."""

from __future__ import annotations

import numpy as np

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import TrueCamera

PLACES = np.array([[0.23, 0.3], [0.77, 0.3], [0.5, 0.72]])
PLACE_JITTER = 0.03  # of the picture
SIDE_RANGE = (0.2, 0.42)  # of the height
MARGIN = 12.0  # pixels to the border
MAX_DRAWS = 5000


def alike_scene(
    rng: np.random.Generator,
    *,
    tilt: tuple[float, float] = (25.0, 50.0),
    apart: float = 0.0,
    scale: float = 1.0,
) -> simulate.Scene:
    """Draw three squares on planes whose normals differ pairwise by `apart` degrees.

    Their sizes, positions and in-plane rotations differ; all are wholly in the picture.
    """
    # Normals at this angle from the common one, 120 degrees apart around it, are `apart` from each
    # other.
    opening = np.degrees(np.arcsin(np.sin(np.radians(apart / 2.0)) / np.sin(np.radians(60.0))))
    for _ in range(MAX_DRAWS):
        camera = simulate.random_camera(rng)
        first = rng.uniform(0.0, 360.0)
        common = simulate.tilted(rng.uniform(*tilt), rng.uniform(0.0, 360.0), 0.0)
        targets = []
        for i, place in enumerate(PLACES):
            rotation = common @ simulate.tilted(opening, first + 120.0 * i, rng.uniform(0.0, 360.0))
            pixel = (place + rng.normal(0.0, PLACE_JITTER, 2)) * camera.image_size
            side = scale * camera.image_size[1] * rng.uniform(*SIDE_RANGE)
            centre = np.append(camera.undistort(pixel[None])[0], 1.0) * camera.fx / side
            if rotation[:, 2] @ centre > 0.3 * np.linalg.norm(centre):
                targets.append(simulate.Target(rotation, centre))
        scene = simulate.Scene(camera, tuple(targets))
        if len(targets) == len(PLACES) and is_seen_whole(scene):
            return scene
    raise ValueError("no such scene fits the picture")


def is_seen_whole(scene: simulate.Scene) -> bool:
    """Return whether all squares, with their curved sides, are inside the picture."""
    camera = scene.camera
    high = np.array(camera.image_size) - 1.0 - MARGIN
    outline = np.concatenate(
        [np.linspace(a, b, 9) for a, b in zip(SQUARE, np.roll(SQUARE, -1, axis=0), strict=True)]
    )
    for target in scene.targets:
        points = target.to_camera(outline)
        if np.any(points[:, 2] <= 0.0):
            return False
        pixels = camera.project(points)
        try:
            back = camera.undistort(pixels)
        except ValueError:
            return False
        # Beyond the valid radius the distortion folds points back into the picture.
        if np.abs(back - points[:, :2] / points[:, 2:]).max() > 1e-6:
            return False
        if np.any(pixels < MARGIN) or np.any(pixels > high):
            return False
    return True


SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def camera_of(truth: TrueCamera) -> ts.Camera:
    """Return the true camera as the package's own class."""
    return ts.Camera(truth.K, truth.distortion, truth.image_size)


def edges_of(
    scene: simulate.Scene, rng: np.random.Generator, noise: float, spacing: float = 4.0
) -> list[ts.PlaneEdges]:
    """Return noisy edge samples of a scene's squares or frames."""
    return [
        ts.PlaneEdges.square(sides[first : first + 4], plane=number)
        for number, sides in enumerate(
            simulate.edge_points(scene, rng, noise=noise, spacing=spacing)
        )
        for first in range(0, len(sides), 4)
    ]
