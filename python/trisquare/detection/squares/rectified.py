"""Whether an outline can be one camera's view of a square.

A homography from the unit square to rays has columns h1, h2 that are perpendicular and of equal
length (Hartley & Zisserman, 2nd ed., section 8.5). With the principal point near the picture's
centre one focal length must do that for all the squares of a picture; other four-sided things
seldom fit. Sides that are bent further than a pinhole's distortion bends them must be straight
under a fisheye lens of that focal length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.squares.quads import Quads

FOCAL_LENGTHS = np.geomspace(0.35, 12.0, 24)
"""Over the picture's longer side: from a wide angle of 110 degrees to a long telephoto lens."""

FISHEYE_FOCAL_LENGTHS = np.geomspace(0.16, 0.8, 12)
"""Of lenses that show a ray's angle with the axis as its distance from the centre: such a picture,
240 degrees across, is as high as a third of its width, or 70 degrees as wide as it."""

MAX_DEVIATION = 0.3
"""Over 1,200 squares of simulated scenes the lens distorts this up to 0.17; of random convex
quadrilaterals one in twenty is below 0.6. The rest is for a principal point off the centre."""

MAX_BEND = 0.07
"""Of a side under a distorted pinhole, over its chord: the strongest lens bends a long side by 4 %,
a quarter circle by 21 %."""

MAX_BEND_LEFT = 0.025
"""Of a side under a fisheye lens of another law than that which is assumed, over its chord."""


def views_of_squares(quads: Quads, image_size: tuple[int, int]) -> Quads:
    """Keep the quads that some camera sees as squares; `image_size` is (width, height)."""
    sides = (quads.sides - 0.5 * (np.array(image_size) - 1.0)) / max(image_size)
    views = _bends(quads.sides) <= MAX_BEND
    views[views] = _are_square(_pinhole_rays(sides[views][:, :, 0])).any(axis=0)
    if not views.all():
        others = np.flatnonzero(~views)
        rays = _fisheye_rays(sides[others])
        seen = _are_square(rays[..., 0, :]) & (_bends_left(rays, sides[others]) <= MAX_BEND_LEFT)
        views[others] = seen.any(axis=0)
    return quads.subset(views)


def _pinhole_rays(points: FloatArray) -> FloatArray:
    """Return rays of centred points (Q, 4, 2) under each focal length, shape (F, Q, 4, 3)."""
    rays = np.empty((len(FOCAL_LENGTHS), *points.shape[:-1], 3))
    rays[..., :2] = points
    rays[..., 2] = FOCAL_LENGTHS[:, None, None]
    return rays


def _fisheye_rays(points: FloatArray) -> FloatArray:
    """Return unit rays of centred points (Q, 4, N, 2), shape (F, Q, 4, N, 3)."""
    angles = np.linalg.norm(points, axis=-1) / FISHEYE_FOCAL_LENGTHS[:, None, None, None]
    # sin(angle) / radius, which is finite at the centre.
    across = np.sinc(angles / np.pi) / FISHEYE_FOCAL_LENGTHS[:, None, None, None]
    return np.concatenate([points * across[..., None], np.cos(angles)[..., None]], axis=-1)


def _are_square(rays: FloatArray) -> NDArray[np.bool_]:
    """Whether rays through four corners, shape (F, Q, 4, 3), are those of a square, shape (F, Q).

    With `h3` the first corner, the others are `h1 + h3`, `h1 + h2 + h3` and `h2 + h3`, each along
    its ray: `a r1 + b r3 - c r2 = r0`. The deviation is the larger of the cosine between `h1` and
    `h2` and the logarithm of their ratio.
    """
    first, second, third, fourth = np.moveaxis(rays, -2, 0)
    system = np.stack([second, fourth, -third], axis=-1)
    singular = np.abs(np.linalg.det(system)) < np.finfo(float).tiny
    system[singular] = np.eye(3)
    scales = np.linalg.solve(system, first[..., None])
    h1 = scales[..., 0, :] * second - first
    h2 = scales[..., 1, :] * fourth - first
    lengths = np.linalg.norm(h1, axis=-1), np.linalg.norm(h2, axis=-1)
    cosine = np.abs((h1 * h2).sum(axis=-1)) / (lengths[0] * lengths[1])
    stretch = np.abs(np.log(lengths[0] / lengths[1]))
    ahead = (scales[..., 0] > 0.0).all(axis=-1) & ~singular
    return np.asarray(ahead & (np.maximum(cosine, stretch) < MAX_DEVIATION))


def _bends(sides: FloatArray) -> FloatArray:
    """How far the sides (Q, 4, N, 2) of outlines leave their chords, over these, shape (Q,)."""
    chords = sides[:, :, -1] - sides[:, :, 0]
    offsets = sides - sides[:, :, :1]
    areas = offsets[..., 0] * chords[:, :, None, 1] - offsets[..., 1] * chords[:, :, None, 0]
    bends = np.abs(areas).max(axis=2) / (chords**2).sum(axis=-1)
    return np.asarray(bends.max(axis=1, initial=0.0))


def _bends_left(rays: FloatArray, sides: FloatArray) -> FloatArray:
    """How far rays leave the planes of their sides' ends, over the chords, shape (F, Q)."""
    normals = np.cross(rays[..., 0, :], rays[..., -1, :])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    angles = np.abs((rays * normals[..., None, :]).sum(axis=-1)).max(axis=-1)
    chords = np.linalg.norm(sides[:, :, -1] - sides[:, :, 0], axis=-1)
    bends = angles * FISHEYE_FOCAL_LENGTHS[:, None, None] / chords
    return np.asarray(bends.max(axis=-1))
