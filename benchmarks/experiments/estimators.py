"""The compared estimators, each from one simulated scene to the error of a camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from accuracy.against_zhang import SAME_MODEL, SUBPIX_END, photograph_boards, zhang_camera
from harness.truth import Array, camera_vector

import trisquare as ts
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene, TrueCamera

BLUR = 0.8  # pixels
CONTRAST = 175.0  # grey levels
DETECTED = 0.3  # pixels: error of a corner detector before cornerSubPix
CORNER_WINDOW = 5
"""Half window of cornerSubPix for the corners of squares, pixels."""

BOARD_WINDOW = 11
"""Half window for boards: that of OpenCV's tutorial, and the better one in `printed_corner`."""

LABELS = {
    "linear": "linear steps",
    "edges": "maximum likelihood, edge points",
    "pixels": "maximum likelihood, pixels",
    "corners": "Zhang, corners of the same squares",
    "boards": "Zhang, 13 photographs of a board",
}
"""Names of the estimators in tables and plots."""

Error = list[float] | None
"""Estimate minus truth of fx, fy, cx, cy and k1; None where the estimator gives no camera."""


def error_of(estimate: Callable[[], Any], truth: TrueCamera) -> Error:
    """Return the error of an estimate: a calibration, or a camera matrix and a distortion."""
    try:
        found = estimate()
    except (ts.TrisquareError, cv2.error):
        return None
    if isinstance(found, ts.Calibration):
        found = found.camera.K, found.camera.distortion
    return (camera_vector(*found) - camera_vector(truth.K, truth.distortion))[:5].tolist()


def zhang_corners(picture: Image, scene: Scene, rng: np.random.Generator) -> tuple[Array, Array]:
    """Calibrate by OpenCV from the corners of a scene's squares.

    Three squares have 24 coordinates, and six parameters of the lens and of each pose are as many
    unknowns, which OpenCV refuses. So k2 is held at 0 for three.

    Returns
    -------
    camera matrix, distortion : ndarray, shapes (3, 3) and (5,)

    Raises
    ------
    cv2.error
        If OpenCV refuses.
    """
    size = scene.camera.image_size
    half = (CORNER_WINDOW, CORNER_WINDOW)
    objects, corners = [], []
    for index, target in enumerate(scene.targets):
        square = target.outlines()[0]
        seen = scene.image_points(index, square) + DETECTED * rng.standard_normal(square.shape)
        start = np.ascontiguousarray(seen[:, None], dtype=np.float32)
        corners.append(cv2.cornerSubPix(picture, start, half, (-1, -1), SUBPIX_END))
        objects.append(np.column_stack([square, np.zeros(len(square))]).astype(np.float32))
    flags = SAME_MODEL | (cv2.CALIB_FIX_K2 if len(objects) <= 3 else 0)
    _, K, distortion, _, _ = cv2.calibrateCamera(objects, corners, size, None, None, flags=flags)
    return K, distortion.ravel()


def zhang_boards(
    camera: TrueCamera, rng: np.random.Generator, photo: dict[str, float]
) -> tuple[Array, Array]:
    """Calibrate with OpenCV from 13 photographs of a chessboard; return as `zhang_corners` does."""
    return zhang_camera(camera, photograph_boards(camera, rng, photo), BOARD_WINDOW)
