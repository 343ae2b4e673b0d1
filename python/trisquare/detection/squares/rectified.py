"""Whether four corners can be one camera's view of a square.

A homography from the unit square has columns h1, h2 that a camera of the right focal length
turns into perpendicular vectors of equal length (Hartley & Zisserman, 2nd ed., section 8.5).
With the principal point near the picture's centre one focal length must do that for all the
squares of a picture; other four-sided things seldom fit.
"""

from __future__ import annotations

import numpy as np

from trisquare.detection.sampling import homographies_from_unit_square
from trisquare.detection.squares.quads import Quads

FOCAL_LENGTHS = np.geomspace(0.35, 12.0, 24)
"""Over the picture's longer side: from a wide angle of 110 degrees to a long telephoto lens."""

MAX_DEVIATION = 0.3
"""Over 1,200 squares of simulated scenes the lens distorts this up to 0.17; of random convex
quadrilaterals one in twenty is below 0.6. The rest is for a principal point off the centre."""


def views_of_squares(quads: Quads, image_size: tuple[int, int]) -> Quads:
    """Keep the quads that some camera sees as squares; `image_size` is (width, height).

    A quad deviates from a square by the larger of the cosine between the sides and the logarithm of
    their ratio, as seen with each of `FOCAL_LENGTHS`.
    """
    centred = (quads.corners - 0.5 * (np.array(image_size) - 1.0)) / max(image_size)
    homographies = homographies_from_unit_square(centred)
    unscaled = np.stack(np.broadcast_arrays(1.0 / FOCAL_LENGTHS, 1.0 / FOCAL_LENGTHS, 1.0), axis=-1)
    sides = homographies[:, None, :, :2] * unscaled[None, :, :, None]
    lengths = np.linalg.norm(sides, axis=2)
    cosine = np.abs(sides.prod(axis=-1).sum(axis=-1)) / lengths.prod(axis=-1)
    stretch = np.abs(np.log(lengths[..., 0] / lengths[..., 1]))
    return quads.subset(np.maximum(cosine, stretch).min(axis=1) < MAX_DEVIATION)
