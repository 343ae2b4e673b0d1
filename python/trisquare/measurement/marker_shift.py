"""The shift of markers' borders toward the light that is common to all markers of a sheet.

A lens displaces the markers smoothly, but a wrong tone curve moves their borders inward or outward:
the shift can be measured without a calibration.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray

POLYNOMIAL_DEGREES = ((12, 3), (6, 2), (4, 1))
"""Minimum numbers of markers, and the degrees of the polynomials over the sheet that they allow:
two equations or more for each unknown."""

MIN_SINE = 1e-3
"""Minimum sine of the angle between two sides of a marker; no marker is seen that flat."""


def marker_shift(model: FloatArray, sides: Sequence[Sequence[FloatArray]]) -> float:
    """Return by how much the borders of markers are shifted toward the light.

    Parameters
    ----------
    model : ndarray, shape (N, 4, 2)
        Corners of the markers, sheet coordinates, clockwise.
    sides : sequence of N sequences of four ndarrays, shape (M, 2)
        Samples along each side, in the order of the corners, pixels.

    Returns
    -------
    float
        In pixels; 0 if the markers are too few.
    """
    degree = next(
        (degree for min_markers, degree in POLYNOMIAL_DEGREES if len(model) >= min_markers), None
    )
    if degree is None:
        return 0.0
    points = np.array([[side.mean(axis=0) for side in marker] for marker in sides])
    along = np.array([[side[-1] - side[0] for side in marker] for marker in sides])
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    before = np.roll(outward, 1, axis=1)
    sines = before[..., 0] * outward[..., 1] - before[..., 1] * outward[..., 0]
    if not (np.abs(sines) > MIN_SINE).all():
        return 0.0
    image_from_sheet, _ = cv2.findHomography(
        model.reshape(-1, 2), _corners(points, outward).reshape(-1, 2)
    )
    if image_from_sheet is None or not np.isfinite(image_from_sheet).all():
        return 0.0
    mapped = cv2.perspectiveTransform(model.reshape(1, -1, 2), image_from_sheet)
    expected = np.asarray(mapped, dtype=np.float64).reshape(model.shape)
    # Samples need not be centred on their sides: only the distance across counts.
    offsets = ((points - expected) * outward).sum(axis=-1).ravel()
    middles = 0.5 * (model + np.roll(model, -1, axis=1)).reshape(-1, 2)
    x, y = (middles / np.abs(middles).max()).T
    terms = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    polynomial = np.stack(terms, axis=1)
    u, v = outward.reshape(-1, 2).T
    design = np.column_stack(
        [np.ones(len(offsets)), polynomial * u[:, None], polynomial * v[:, None]]
    )
    solution = np.linalg.lstsq(design, offsets, rcond=None)[0]
    return float(solution[0])


def _corners(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return where each side meets the one before, shape (N, 4, 2)."""
    offsets = (points * normals).sum(axis=-1)
    both = np.stack([np.roll(normals, 1, axis=1), normals], axis=-2)
    right = np.stack([np.roll(offsets, 1, axis=1), offsets], axis=-1)
    return np.asarray(np.linalg.solve(both, right[..., None])[..., 0])
