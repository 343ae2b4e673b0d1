"""Detected targets, whether or not a camera could be calibrated from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare._support.records import INDEX, TEXT, Record, member, pixels
from trisquare.edges import PlaneEdges
from trisquare.errors import TrisquareError

PARALLEL = 0.1
"""Sine of the angle below which two lines of a figure's model count as parallel; the lines of
squares and grids are parallel or perpendicular."""

MAX_EXTRAPOLATION = 1.0
"""Maximum distance of a corner from the samples' bounding box, relative to its size: a corner
farther away is near the horizon."""


@dataclass(frozen=True, slots=True, eq=False)
class PartialDetection(Record):
    """A target that was found and measured in a picture.

    Parameters
    ----------
    kind : str
        Kind of target: ``"square"``, ``"frame"``, ``"chessboard"``, ...
    image : int
        Index of the picture it was found in.
    corners : array_like, shape (4, 2)
        Its corners, in pixels of the photograph; a board's outermost crossings.

    Examples
    --------
    >>> import cv2
    >>> try:
    ...     ts.calibrate(cv2.imread("photo.jpg")[:480, :560])  # one square of three
    ... except ts.NotEnoughPlanesError as error:
    ...     print([target.kind for target in error.found])
    ['frame']
    """

    kind: str = field(metadata=member(TEXT))
    image: int = field(metadata=member(INDEX))
    corners: FloatArray = field(metadata=member(pixels(4, 2)))

    def __repr__(self) -> str:
        x, y = self.corners.mean(axis=0).tolist()
        return f"<PartialDetection {self.kind} in image {self.image} around ({x:.0f}, {y:.0f})>"


def partial_detections(figures: Iterable[PlaneEdges]) -> list[PartialDetection]:
    """Return the detection of the first figure of each plane."""
    planes: set[int] = set()
    found = []
    for figure in figures:
        if figure.plane is None or figure.plane not in planes:
            found.append(PartialDetection(figure.kind, figure.image, _corners(figure)))
        if figure.plane is not None:
            planes.add(figure.plane)
    return found


def _corners(figure: PlaneEdges) -> FloatArray:
    """Return the corners of the rectangle around a figure's lines, exact to a few pixels."""
    samples = np.concatenate(figure.points)
    low, high = samples.min(axis=0), samples.max(axis=0)
    around = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    crossings = _crossings(figure.lines)
    if len(crossings) < 3:
        return around
    try:
        image_lines = np.array([_line(points) for points in figure.points])
        homography = _core.homography_from_lines(figure.lines, image_lines)
    except TrisquareError:
        return around
    (left, top), (right, bottom) = crossings.min(axis=0), crossings.max(axis=0)
    rectangle = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1]])
    homogeneous = rectangle @ homography.T
    depths = homogeneous[:, 2]
    if not (np.abs(depths).min() > 0 and np.ptp(np.sign(depths)) == 0):
        return around
    corners = homogeneous[:, :2] / depths[:, None]
    reach = MAX_EXTRAPOLATION * (high - low)
    near = (corners >= low - reach).all() and (corners <= high + reach).all()
    return np.asarray(corners) if near else around


def _crossings(lines: FloatArray) -> FloatArray:
    """Return the crossings of the lines (L, 3) of a model, shape (C, 2)."""
    i, j = np.triu_indices(len(lines), 1)
    points = np.cross(lines[i], lines[j])
    across = np.abs(points[:, 2]) > PARALLEL
    return np.asarray(points[across, :2] / points[across, 2:])


def _line(points: FloatArray) -> FloatArray:
    """Return the line ``(a, b, c)`` that fits points best."""
    centre = points.mean(axis=0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    normal = vectors[:, int(np.argmin(values))]
    return np.array([*normal, -normal @ centre])
