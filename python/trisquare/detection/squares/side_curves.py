"""Smooth curved sides through rough quads, measured on the grey picture itself.

Contour pixels lie up to a pixel beside the edge and scatter with the noise. A cubic through the
edge positions along a side removes both errors, and rejects what looks four-cornered at one
threshold only: its edge is missing, has the wrong sign, or is not a smooth curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare.detection.squares.quads import Quads, without_repeats

MIN_INLIERS = 0.85
"""Minimum fraction of a side's points on its curve, with the side's own contrast ..."""

MIN_INLIERS_HIDDEN = 0.65
"""... and that of the one side, if any, of which a finger, glare or a tear may hide a quarter, with
the blur at both ends."""

MAX_CORNER_COSINE = float(np.cos(np.deg2rad(25.0)))
"""Maximum cosine of a corner's angle: between 25 and 155 degrees; beyond, the square is seen too
flat to measure."""


def fit_sides(
    picture: NDArray[np.uint8],
    quads: Quads,
    least_inliers: tuple[float, float] = (MIN_INLIERS, MIN_INLIERS_HIDDEN),
) -> Quads:
    """Measure the quads' sides and keep the quads whose four sides are smooth edges.

    Parameters
    ----------
    picture : ndarray of uint8, shape (H, W)
    quads : Quads
        Rough, within about a pixel and a half of the edge; in order of preference.
    least_inliers : (float, float)
        Minimum fraction of a side's points on its curve, and that of the weakest side.

    Returns
    -------
    Quads
        Within a few tenths of a pixel of the edge, each outline once.
    """
    kept, sides, contrasts, seen = _core.fit_sides(
        picture, quads.sides, quads.dark_inside, *least_inliers, MAX_CORNER_COSINE
    )
    return without_repeats(Quads(sides, quads.dark_inside[kept], contrasts, seen))
