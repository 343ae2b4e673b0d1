"""Camera and planes in three dimensions, as numbers that the page's script draws."""

from __future__ import annotations

from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.analysis.plan import onto_plane
from trisquare.camera.camera import Camera
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

PYRAMID = 0.3
"""Length of the camera's pyramid, relative to the distance of the nearest plane."""

DIGITS = 5
"""Number of significant digits of a coordinate: more than a screen shows."""


def scene_of(calibration: Calibration) -> dict[str, Any] | None:
    """Return the camera and the poses of the planes, in the camera's frame.

    The unit is each plane's own side: true sizes are unknown, and a square of twice the size is at
    twice the distance in the same direction. The relative poses of several photographs are unknown
    too: the planes of all photographs are shown before one camera.

    Returns
    -------
    dict or None
        ``camera``, the four corners of its pyramid's base, and ``planes``, each with its
        ``number``, its ``image`` and its four ``corners``; points are lists of X, Y and Z. None if
        no plane is in front of the camera.
    """
    planes = [
        (number, plane.image, corners)
        for number, plane in enumerate(calibration.planes)
        if (corners := _corners(plane, calibration.camera)) is not None
    ]
    if not planes:
        return None
    nearest = min(float(np.linalg.norm(corners.mean(axis=0))) for _, _, corners in planes)
    return {
        "camera": _listed(_pyramid(calibration.camera, PYRAMID * nearest)),
        "planes": [
            {"number": number, "image": image, "corners": _listed(corners)}
            for number, image, corners in planes
        ],
    }


def _corners(plane: Plane, camera: Camera) -> FloatArray | None:
    """Return a plane's corners in the camera frame; None if they are not in front of the camera."""
    try:
        flat = onto_plane(plane.corners, camera, plane)
    except ValueError:
        return None
    corners = flat @ plane.rotation[:, :2].T + plane.translation
    return corners if np.all(corners[:, 2] > 0.0) else None


def _pyramid(camera: Camera, length: float) -> FloatArray:
    """Return the base of the pyramid of the picture's corners, without distortion, shape (4, 3)."""
    width, height = camera.image_size
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    rays = np.column_stack([pixels, np.ones(4)]) @ np.linalg.inv(camera.K).T
    longest = float(np.linalg.norm(rays, axis=1).max())
    return np.asarray(rays * length / longest)


def _listed(points: FloatArray) -> list[list[float]]:
    return [[float(f"{number:.{DIGITS}g}") for number in point] for point in points.tolist()]
