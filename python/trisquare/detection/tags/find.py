"""Markers of one dictionary, by OpenCV's detector."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.tags.codes import opencv_dictionary
from trisquare.detection.tags.decode import BORDER

SMALLEST_SIDE = 10.0
"""Minimum shortest side of a marker, pixels: below it nothing remains between its corners' blur."""


class Marker(NamedTuple):
    """A marker found by OpenCV's detector: corners clockwise from the code's top left."""

    number: int
    corners: FloatArray  # (4, 2)
    border: float  # its width over the marker's side


def detect_markers(
    grey: NDArray[np.uint8], name: str, border: int = BORDER, longest_side: int | None = None
) -> tuple[list[Marker], list[FloatArray]]:
    """Find the markers of a dictionary, and other outlines with four corners.

    The minimum size is that in a picture of `longest_side`, of which this may be a part.
    """
    parameters = cv2.aruco.DetectorParameters()
    # The detector takes the minimum as a fraction of the longest side.
    parameters.minMarkerPerimeterRate *= (longest_side or max(grey.shape)) / max(grey.shape)
    parameters.markerBorderBits = border
    detector = cv2.aruco.ArucoDetector(opencv_dictionary(name), parameters)
    corners, numbers, others = detector.detectMarkers(grey)
    share = border / (opencv_dictionary(name).markerSize + 2 * border)
    markers = [
        Marker(int(number), np.asarray(quad, dtype=np.float64).reshape(4, 2), share)
        for number, quad in zip(
            [] if numbers is None else np.ravel(numbers).tolist(), corners, strict=True
        )
    ]
    large = [marker for marker in markers if shortest_side(marker.corners) >= SMALLEST_SIDE]
    return large, [np.asarray(quad, dtype=np.float64).reshape(4, 2) for quad in others]


def shortest_side(corners: FloatArray) -> float:
    """Length of the shortest side of a quadrilateral (4, 2)."""
    return float(shortest_sides(corners[None])[0])


def shortest_sides(quads: FloatArray) -> FloatArray:
    """Lengths of the shortest sides of quadrilaterals (N, 4, 2)."""
    along = quads - np.roll(quads, 1, axis=1)
    return np.asarray(np.linalg.norm(along, axis=2).min(axis=1))
