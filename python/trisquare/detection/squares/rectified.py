"""Test whether an outline can be one camera's view of a square, or of a rectangle of known shape.

The columns h1, h2 of a homography from the unit square to rays are perpendicular, and of equal
length for a square (Hartley & Zisserman, 2nd ed., section 8.5); for a rectangle, the ratio of their
lengths is that of its sides. With the principal point near the picture's centre, one focal length
must satisfy this for all the squares of a picture; other four-sided things seldom fit. Sides bent
more than a pinhole's distortion bends them must be straight under a fisheye lens of that focal
length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.square_views import (
    FISHEYE_FOCAL_LENGTHS,
    bends,
    centred,
    fisheye_rays,
    residual_bends,
    square_columns,
)
from trisquare.detection.squares.quads import Quads

FOCAL_LENGTHS = np.geomspace(0.35, 12.0, 24)
"""Focal lengths over the picture's longer side: from a wide angle of 110 degrees to a long
telephoto lens."""

MAX_DEVIATION = 0.3
"""Maximum deviation of a quad from a rectangle. In 1,200 squares of simulated scenes lens
distortion raises it up to 0.17; of random convex quadrilaterals one in twenty is below 0.6. The
rest is for a principal point off the centre."""

MAX_BEND = 0.07
"""Maximum bend of a side under a distorted pinhole, over its chord: the strongest lens bends a long
side by 4 %; a quarter circle is bent by 21 %."""

MAX_RESIDUAL_BEND = 0.025
"""Maximum remaining bend of a side, over its chord, under a fisheye lens of another projection than
the assumed one."""


def views_of_rectangles(
    quads: Quads, image_size: tuple[int, int], aspect: float | None = 1.0
) -> Quads:
    """Keep the quads that some camera can see as rectangles.

    Parameters
    ----------
    quads : Quads
    image_size : tuple of int
        Width and height.
    aspect : float, optional
        The longer side over the shorter; None for any.
    """
    sides = centred(quads.sides, image_size)
    is_view = bends(quads.sides) <= MAX_BEND
    is_view[is_view] = _are_rectangle_rays(_pinhole_rays(sides[is_view][:, :, 0]), aspect).any(
        axis=0
    )
    if not is_view.all():
        bent = np.flatnonzero(~is_view)
        rays = fisheye_rays(sides[bent], FISHEYE_FOCAL_LENGTHS)
        is_straight = residual_bends(rays, sides[bent], FISHEYE_FOCAL_LENGTHS) <= MAX_RESIDUAL_BEND
        is_view[bent] = (_are_rectangle_rays(rays[..., 0, :], aspect) & is_straight).any(axis=0)
    return quads.subset(is_view)


def rectangle_deviations(
    corners: FloatArray, image_size: tuple[int, int], aspect: float | None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Compare quads, corners (Q, 4, 2), with rectangles, under each of F lenses.

    Returns
    -------
    deviations : ndarray of float64, shape (F, Q)
        Deviation of each from a rectangle of the aspect.
    is_longer : ndarray of bool, shape (F, Q)
        Whether its side 0 is the longer.
    """
    corners = centred(corners, image_size)
    fisheye = fisheye_rays(corners[:, :, None], FISHEYE_FOCAL_LENGTHS)[..., 0, :]
    rays = np.concatenate([_pinhole_rays(corners), fisheye])
    cosines, stretches = _shapes(rays)
    return _deviations(cosines, stretches, aspect), np.asarray(stretches > 0.0)


def closeness(deviations: FloatArray) -> FloatArray:
    """Return by how much deviations from rectangles are below the maximum, in squares."""
    return np.asarray(MAX_DEVIATION**2 - np.clip(deviations, 0.0, MAX_DEVIATION) ** 2)


def _pinhole_rays(points: FloatArray) -> FloatArray:
    """Return rays of centred points (Q, 4, 2) under each focal length, shape (F, Q, 4, 3)."""
    rays = np.empty((len(FOCAL_LENGTHS), *points.shape[:-1], 3))
    rays[..., :2] = points
    rays[..., 2] = FOCAL_LENGTHS[:, None, None]
    return rays


def _are_rectangle_rays(rays: FloatArray, aspect: float | None) -> NDArray[np.bool_]:
    """Return whether rays through four corners, (F, Q, 4, 3), are a rectangle's, shape (F, Q)."""
    return np.asarray(_deviations(*_shapes(rays), aspect) < MAX_DEVIATION)


def _deviations(cosines: FloatArray, stretches: FloatArray, aspect: float | None) -> FloatArray:
    """Return deviations from rectangles: the larger of cosine and error of the aspect's logarithm.

    Either way up; the cosine alone if the aspect is None.
    """
    if aspect is None:
        return cosines
    return np.asarray(np.maximum(cosines, np.abs(np.abs(stretches) - np.log(aspect))))


def _shapes(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosines between sides 0 and 3 in space, and logarithms of their ratio; both (F, Q).

    The cosine is infinite where corners are not in front of the camera.
    """
    columns, is_ahead = square_columns(rays)
    h1, h2 = columns[..., 0], columns[..., 1]
    lengths = np.linalg.norm(h1, axis=-1), np.linalg.norm(h2, axis=-1)
    cosines = np.abs((h1 * h2).sum(axis=-1)) / (lengths[0] * lengths[1])
    cosines[~is_ahead] = np.inf
    return cosines, np.log(lengths[0] / lengths[1])
