"""Inner corners of one chessboard: OpenCV's search, its strays put right, settled on the saddles.

OpenCV's sector-based search finds boards that nothing else does, but now and then puts a corner
at the board's rim up to half a cell beside its place.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice
from trisquare.detection.grey import MIN_PICTURE, grey_bytes

MAX_STRAY = 0.12
"""Cells from the smooth grid beyond which a corner is a stray; the lens leaves 0.05."""

REWEIGHTINGS = 12
"""Least absolute deviations by reweighting: a few strays lose their weight by the tenth."""

SETTLED = 0.5
"""Pixels below which deviations weigh the same; the search's own scatter."""

WINDOW = 0.3
MAX_WINDOW = 10
"""Half window of the saddle search, in cells and at most in pixels: no other corner is in it."""

SADDLE_ITERATIONS = 30
SADDLE_STEP = 0.01
"""The saddle search ends at a hundredth of a pixel, finer than anything asks of it."""


def chessboard_corners(grey: NDArray[np.uint8], cols: int, rows: int) -> FloatArray | None:
    """Find a chessboard's inner corners, shape (rows, cols, 2), or None.

    Columns go clockwise from rows on the screen.
    """
    found, points = cv2.findChessboardCornersSB(
        grey, (cols, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    )
    if not found:
        found, points = cv2.findChessboardCorners(
            grey, (cols, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ADAPTIVE_THRESH
        )
    if not found:
        return None
    corners = np.asarray(points, dtype=np.float64).reshape(rows, cols, 2)
    across, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0.0:
        corners = corners[:, ::-1]
    return _on_saddles(grey, _without_strays(corners))


def _without_strays(corners: FloatArray) -> FloatArray:
    """Move corners that leave the smooth grid of the others onto it."""
    rows, cols = corners.shape[:2]
    if min(rows, cols) < 4:
        return corners  # as many unknowns as corners: nothing would tell a stray
    v, u = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, cols), indexing="ij")
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    basis = np.stack([u.ravel() ** i * v.ravel() ** j for i, j in powers], axis=1)
    points = corners.reshape(-1, 2)
    deviation = np.ones(len(points))
    for _ in range(REWEIGHTINGS):
        weight = 1.0 / np.sqrt(np.maximum(deviation, SETTLED))[:, None]
        smooth = basis @ np.linalg.lstsq(weight * basis, weight * points, rcond=None)[0]
        deviation = np.linalg.norm(points - smooth, axis=1)
    stray = deviation > MAX_STRAY * _cell(corners)
    return np.where(stray[:, None], smooth, points).reshape(corners.shape)


def _on_saddles(grey: NDArray[np.uint8], corners: FloatArray) -> FloatArray:
    """Settle each corner on the saddle of the grey levels next to it."""
    half = int(np.clip(WINDOW * _cell(corners), 2, MAX_WINDOW))
    points = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, SADDLE_ITERATIONS, SADDLE_STEP)
    settled = cv2.cornerSubPix(grey, points, (half, half), (-1, -1), end)
    return np.asarray(settled, dtype=np.float64).reshape(corners.shape)


def _cell(corners: FloatArray) -> float:
    """Side of a typical small cell in pixels; a stray must not decide it."""
    steps = [np.linalg.norm(np.diff(corners, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.percentile(np.concatenate(steps), 10.0))


def find_chessboard(image: NDArray[np.generic], cols: int, rows: int) -> Lattice | None:
    """Find the one chessboard with `cols` x `rows` inner corners.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    cols, rows : int
        Inner corners along the board's two directions, at least 3 each.

    Returns
    -------
    Lattice or None
        None if the picture shows no such board.
    """
    if min(cols, rows) < 3:
        raise ValueError(f"a chessboard needs 3 x 3 inner corners or more, not {cols} x {rows}")
    grey = grey_bytes(image)
    if min(grey.shape) < MIN_PICTURE:
        return None
    corners = chessboard_corners(grey, cols, rows)
    if corners is None:
        return None
    corners.flags.writeable = False
    return Lattice(corners, np.ones(corners.shape[:2], bool))
