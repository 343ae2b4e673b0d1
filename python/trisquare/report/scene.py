"""Camera and planes in three dimensions, as numbers that the page's script draws and turns."""

from __future__ import annotations

from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.analysis.plan import onto_plane
from trisquare.camera.camera import Camera
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

PYRAMID = 0.3
"""Length of the camera's pyramid over the distance of the nearest plane."""

DIGITS = 5
"""Of a coordinate: more than a screen shows."""


def scene_of(calibration: Calibration) -> dict[str, Any] | None:
    """Return where the camera and the planes stand, in the camera's frame.

    Each plane's own side is the unit: true sizes are not known, and a square that is twice as large
    stands twice as far away in the same direction. Nor is known how the photographs stand to each
    other: the planes of all of them are as the one camera saw them.

    Returns
    -------
    dict or None
        ``camera``, the four corners of its pyramid's base, and ``planes``, each with its
        ``number``, its ``image`` and its four ``corners``; points are lists of X, Y and Z. None if
        no plane stands before the camera.
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
    """Return where a plane's corners stand; None if they do not stand before the camera."""
    try:
        flat = onto_plane(plane.corners, camera, plane)
    except ValueError:
        return None
    corners = flat @ plane.rotation[:, :2].T + plane.translation
    return corners if np.all(corners[:, 2] > 0.0) else None


def _pyramid(camera: Camera, length: float) -> FloatArray:
    """Return the base of the pyramid that the picture spans, without the lens's bend, (4, 3)."""
    width, height = camera.image_size
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    rays = np.column_stack([pixels, np.ones(4)]) @ np.linalg.inv(camera.K).T
    longest = float(np.linalg.norm(rays, axis=1).max())
    return np.asarray(rays * length / longest)


def _listed(points: FloatArray) -> list[list[float]]:
    return [[float(f"{number:.{DIGITS}g}") for number in point] for point in points.tolist()]
