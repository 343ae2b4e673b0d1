"""How much room the edges of a marker have: up to its bits inside, to the next print outside."""

from __future__ import annotations

import math

import cv2
import numpy as np

from trisquare.checked import FloatArray

SHARE = 0.5
"""Of the border and of the gap that is used: the other half is blurred by what comes next."""

PLACES = (0.1, 0.5, 0.9)
"""Along a side, as parts of it, where the room is looked up; the least counts."""

UNIT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)


def side_room(corners: FloatArray, border: float, gap: float) -> list[tuple[float, float]]:
    """Return the room on the left, outside, and on the right of each side.

    Parameters
    ----------
    corners : ndarray, shape (4, 2)
        Of the marker, clockwise on the screen, pixels.
    border, gap : float
        Of its plain border and of the white round it, over its side; infinite where nothing comes
        next.

    Returns
    -------
    list of four tuples of float
        Pixels.
    """
    inside, outside = (_room(corners, share) for share in (border, -gap))
    return list(zip(outside, inside, strict=True))


def _room(corners: FloatArray, share: float) -> list[float]:
    """Distance from each side to the line that runs inside of it by this part of the square."""
    if math.isinf(share):
        return [math.inf] * 4
    turned = [np.roll(corners, -side, axis=0).astype(np.float32) for side in range(4)]
    room = []
    for quad in turned:
        beside = np.array([[(place, SHARE * share) for place in PLACES]])
        seen = cv2.perspectiveTransform(beside, cv2.getPerspectiveTransform(UNIT, quad))[0]
        along = (quad[1] - quad[0]).astype(np.float64)
        off = np.asarray(seen, dtype=np.float64) - quad[0]
        room.append(float(np.abs(along[0] * off[:, 1] - along[1] * off[:, 0]).min()))
        room[-1] /= max(float(np.hypot(*along)), 1e-9)
    return room
