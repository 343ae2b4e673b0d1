"""Sides of a four-cornered region from which a finger, glare or a tear takes a bite.

At a threshold between the figure and what lies over it the region has a notch, which no polygon
of four corners follows. Its convex hull has the right corners all the same.
"""

from __future__ import annotations

import cv2
import numpy as np
from cv2.typing import MatLike

from trisquare._support.arrays import FloatArray

POINTS_PER_SIDE = 32
FRACTIONS = np.linspace(0.0, 1.0, POINTS_PER_SIDE)
"""Places along a side at which outlines are sampled, corner to corner."""

HULL_STEPS = (0.015, 0.03)
"""Tolerances of the hull's polygon, over its length: a bulge of 4 % of a side is 1 %."""

MIN_FILLING = 0.55
"""Area over the hull's: a notch takes a tenth, and a frame that is cut through loses its hole."""


def sides_of_bitten(contour: MatLike, area: float) -> FloatArray | None:
    """Sides of a region whose convex hull has four corners.

    Parameters
    ----------
    contour : ndarray of int32, shape (N, 1, 2)
        Pixels, every one of the outline.
    area : float
        Its oriented area, positive if it runs clockwise on the screen.

    Returns
    -------
    ndarray of float64, shape (4, POINTS_PER_SIDE, 2), or None
        In the order of the contour, corner to corner: its outermost points, the notch's included.
        None if the hull has not four corners, or is mostly empty.
    """
    hull = cv2.convexHull(contour)
    if abs(area) < MIN_FILLING * cv2.contourArea(hull):
        return None
    for step in HULL_STEPS:
        polygon = cv2.approxPolyDP(hull, step * cv2.arcLength(hull, closed=True), closed=True)
        if len(polygon) <= 4:
            break
    if len(polygon) != 4:
        return None
    corners = polygon[:, 0].astype(np.float64)
    if cv2.contourArea(polygon, oriented=True) * area < 0.0:
        corners = corners[::-1]
    points = contour[:, 0].astype(np.float64)
    ends = np.roll(corners, -1, axis=0)
    return np.array(
        [_outermost(points, start, end, area) for start, end in zip(corners, ends, strict=True)]
    )


def _outermost(points: FloatArray, start: FloatArray, end: FloatArray, area: float) -> FloatArray:
    """Points of a contour that lie farthest out at `FRACTIONS` of a chord, shape (N, 2)."""
    chord = end - start
    length = np.hypot(*chord)
    outward = np.array([chord[1], -chord[0]]) / (length if area > 0.0 else -length)
    relative = points - start
    place = relative @ chord / length**2 * (POINTS_PER_SIDE - 1)
    offset = relative @ outward
    index = np.rint(place).astype(np.intp)
    inside = (index >= 0) & (index < POINTS_PER_SIDE)
    farthest = np.full(POINTS_PER_SIDE, -np.inf)
    np.maximum.at(farthest, index[inside], offset[inside])
    farthest[[0, -1]] = 0.0
    known = np.isfinite(farthest)
    offsets = np.interp(FRACTIONS, FRACTIONS[known], farthest[known])
    return np.asarray(start + FRACTIONS[:, None] * chord + offsets[:, None] * outward)
