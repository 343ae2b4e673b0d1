"""Edges of concentric circles with known truth, and the best accuracy that they allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from trisquare.simulate.scene import Array, Scene, TrueCamera

ROUND = 2.0 * np.pi
DENSE = 20000
STEP = 1e-6
CAMERA = ("fx", "fy", "cx", "cy", "k1", "k2")
# A turn about the centre changes no circle's image: information about it is a rounding error.
NO_INFORMATION = 1e-10


def circle_edges(
    scene: Scene,
    rng: np.random.Generator,
    radii: Sequence[float],
    *,
    noise: float = 0.1,
    spacing: float = 4.0,
    centre: Sequence[float] = (0.0, 0.0),
    extent: float = 1.0,
) -> list[list[Array]]:
    """Return noisy samples of circles on every target's plane.

    Parameters
    ----------
    scene : Scene
        Its targets give the poses of the planes; they are not drawn themselves.
    rng : numpy.random.Generator
        Source of the noise.
    radii : sequence of float
        Radii, in units of a target's side.
    noise : float
        Standard deviation of each offset across the circle's image, pixels.
    spacing : float
        Pixels between samples.
    centre : sequence of float, shape (2,)
        Centre of all circles, on the plane.
    extent : float
        Fraction of each circle that is seen, from a random place on.
    """
    edges = []
    for target in range(len(scene.targets)):
        own = []
        for radius in radii:
            angles = _angles(scene, target, radius, spacing, centre)
            if extent < 1.0:
                angles = angles[
                    (angles - rng.uniform(0, 2 * np.pi)) % (2 * np.pi) < extent * 2 * np.pi
                ]
            points, normals = _seen(scene, target, radius, angles, centre)
            own.append(points + normals * rng.normal(0.0, noise, (len(points), 1)))
        edges.append(own)
    return edges


def circle_bound(
    scene: Scene,
    radii: Sequence[float],
    *,
    noise: float = 0.1,
    spacing: float = 4.0,
    any_radii: bool = False,
) -> dict[str, float]:
    """Return the Cramer-Rao bounds of the camera's parameters from circles on every plane.

    Parameters
    ----------
    scene, radii, noise, spacing
        As for `circle_edges`.
    any_radii : bool
        Whether all radii but the first one's are unknown.

    Returns
    -------
    dict of str to float
        By the names of `CAMERA`.
    """
    shared = np.zeros((len(CAMERA), len(CAMERA)))
    for target in range(len(scene.targets)):
        rows = []
        for number, radius in enumerate(radii):
            angles = _angles(scene, target, radius, spacing)
            _, normals = _seen(scene, target, radius, angles)
            slopes = [
                np.sum(slope * normals, axis=1) for slope in _slopes(scene, target, radius, angles)
            ]
            radius_columns = np.zeros((len(radii) - 1 if any_radii else 0, len(angles)))
            if any_radii and number > 0:
                radius_columns[number - 1] = slopes[-1]
            rows.append(np.stack([*slopes[:-1], *radius_columns], axis=1))
        jacobian = np.concatenate(rows) / noise
        information = jacobian.T @ jacobian
        plane_information = information[len(CAMERA) :, len(CAMERA) :]
        cross = information[len(CAMERA) :, : len(CAMERA)]
        inverse = np.linalg.pinv(plane_information, rcond=NO_INFORMATION, hermitian=True)
        shared += information[: len(CAMERA), : len(CAMERA)] - cross.T @ inverse @ cross
    deviations = np.sqrt(np.diag(np.linalg.inv(shared)))
    return dict(zip(CAMERA, deviations.tolist(), strict=True))


def _points(angles: Array, radius: float, centre: Sequence[float]) -> Array:
    points: Array = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(points + np.asarray(centre))


def _angles(
    scene: Scene, target: int, radius: float, spacing: float, centre: Sequence[float] = (0.0, 0.0)
) -> Array:
    """Return angles of points evenly spread along a circle's image."""
    dense = np.linspace(0.0, ROUND, DENSE)
    image = scene.image_points(target, _points(dense, radius, centre))
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(image, axis=0), axis=1)))
    count = int(along[-1] / spacing)
    places = (np.arange(count) + 0.5) / count * along[-1]
    return np.asarray(np.interp(places, along, dense))


def _seen(
    scene: Scene, target: int, radius: float, angles: Array, centre: Sequence[float] = (0.0, 0.0)
) -> tuple[Array, Array]:
    """Return points on a circle's image and its unit normals there, each shape (N, 2)."""
    image = scene.image_points(target, _points(angles, radius, centre))
    ahead = scene.image_points(target, _points(angles + STEP, radius, centre))
    behind = scene.image_points(target, _points(angles - STEP, radius, centre))
    along = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    return image, np.stack([-along[:, 1], along[:, 0]], axis=1)


def _slopes(scene: Scene, target: int, radius: float, angles: Array) -> list[Array]:
    """Return the image's central differences by the camera, the pose and the radius."""
    plane = scene.targets[target]

    def image(change: Array) -> Array:
        of_camera, turn, shift = change[:6], change[6:9], change[9:12]
        points = plane.to_camera(_points(angles, radius + change[12], (0.0, 0.0)))
        return _changed(scene.camera, of_camera).project(points @ cv2.Rodrigues(turn)[0].T + shift)

    units = np.eye(13)
    # Focal lengths and centre are in the hundreds of pixels.
    units[:4] *= scene.camera.fx
    return [
        (image(STEP * unit) - image(-STEP * unit)) / (2.0 * STEP * unit.max()) for unit in units
    ]


def _changed(camera: TrueCamera, change: Array) -> TrueCamera:
    fx, fy, cx, cy, k1, k2 = change.tolist()
    return replace(
        camera,
        fx=camera.fx + fx,
        fy=camera.fy + fy,
        cx=camera.cx + cx,
        cy=camera.cy + cy,
        distortion=camera.distortion + np.array([k1, k2, 0.0, 0.0, 0.0]),
    )
