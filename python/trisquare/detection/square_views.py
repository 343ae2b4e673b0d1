"""Positions of a square's points within quads that may be its images, also under wide lenses.

A side that the lens bends is straight among its rays: the focal length that makes the sides of a
quad straight also gives the positions of the points within.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

FISHEYE_FOCAL_LENGTHS = np.geomspace(0.16, 0.8, 12)
"""Focal lengths, over the picture's longer side, of fisheyes whose distances from the centre are
proportional to the angle from the axis: from a circle of 240 degrees with a radius of a third of
that side, to 70 degrees across that side."""

PINHOLE = 8.0
"""Focal length, over the picture's longer side, of a fisheye that is as good as a pinhole."""

MAX_STRAIGHT_BEND = 0.01
"""Bend of a side, over its chord, up to which a quad is read by its corners alone."""


@dataclass(frozen=True, slots=True, eq=False)
class SquareViews:
    """Quads as views of squares, each with the focal length that makes its sides straight."""

    columns: FloatArray  # (Q, 3, 3), of homographies from the unit square to rays
    focal_lengths: FloatArray  # (Q,), over the picture's longer side
    image_size: tuple[int, int]

    @classmethod
    def of(cls, sides: FloatArray, image_size: tuple[int, int]) -> SquareViews:
        """Build views from sides, (Q, 4, N, 2), clockwise on the screen, and a width and height."""
        points = centred(sides, image_size)
        focal_lengths = np.full(len(sides), PINHOLE)
        bent = np.flatnonzero(bends(sides) > MAX_STRAIGHT_BEND)
        if bent.size:
            trial_focals = np.append(FISHEYE_FOCAL_LENGTHS, PINHOLE)
            residuals = residual_bends(
                fisheye_rays(points[bent], trial_focals), points[bent], trial_focals
            )
            focal_lengths[bent] = trial_focals[residuals.argmin(axis=0)]
        corners = _rays(points[:, :, 0], focal_lengths[:, None])
        return cls(square_columns(corners)[0], focal_lengths, image_size)

    def __len__(self) -> int:
        return len(self.columns)

    def subset(self, keep: slice) -> SquareViews:
        """Return the views of some of the quads."""
        return replace(self, columns=self.columns[keep], focal_lengths=self.focal_lengths[keep])

    def points(self, square: FloatArray) -> FloatArray:
        """Return pixels of points of the unit square, (N, 2), in every quad, shape (Q, N, 2)."""
        rays = np.column_stack([square, np.ones(len(square))]) @ np.swapaxes(self.columns, 1, 2)
        across = np.linalg.norm(rays[..., :2], axis=-1)
        angles = np.arctan2(across, rays[..., 2])
        radii = self.focal_lengths[:, None] * angles / np.maximum(across, np.finfo(float).tiny)
        middle = 0.5 * (np.array(self.image_size) - 1.0)
        return np.asarray(middle + max(self.image_size) * radii[..., None] * rays[..., :2])


def centred(points: FloatArray, image_size: tuple[int, int]) -> FloatArray:
    """Return points relative to the middle of a picture, over its longer side."""
    return (points - 0.5 * (np.array(image_size) - 1.0)) / max(image_size)


def fisheye_rays(points: FloatArray, focal_lengths: FloatArray) -> FloatArray:
    """Return unit rays of centred points (Q, 4, N, 2), shape (F, Q, 4, N, 3)."""
    focal = focal_lengths[:, None, None, None]
    return _rays(points, focal)


def _rays(points: FloatArray, focal: FloatArray) -> FloatArray:
    angles = np.linalg.norm(points, axis=-1) / focal
    # sin(angle) / radius, which is finite at the centre.
    across = np.sinc(angles / np.pi) / focal
    return np.concatenate([points * across[..., None], np.cos(angles)[..., None]], axis=-1)


def square_columns(rays: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return homographies from the unit square to rays through four corners, shape (..., 4, 3).

    With `h3` the first corner, the others are `h1 + h3`, `h1 + h2 + h3` and `h2 + h3`, each along
    its ray: `a r1 + b r3 - c r2 = r0`.

    Returns
    -------
    columns : ndarray, shape (..., 3, 3)
        `h1`, `h2` and `h3`.
    is_ahead : ndarray of bool, shape (...)
        Whether the corners are in front of the camera, along their rays.
    """
    first, second, third, fourth = np.moveaxis(rays, -2, 0)
    system = np.stack([second, fourth, -third], axis=-1)
    is_singular = np.abs(np.linalg.det(system)) < np.finfo(float).tiny
    system[is_singular] = np.eye(3)
    scales = np.linalg.solve(system, first[..., None])
    h1 = scales[..., 0, :] * second - first
    h2 = scales[..., 1, :] * fourth - first
    is_ahead = (scales[..., 0] > 0.0).all(axis=-1) & ~is_singular
    return np.stack([h1, h2, first], axis=-1), np.asarray(is_ahead)


def bends(sides: FloatArray) -> FloatArray:
    """Return how far outlines' sides (Q, 4, N, 2) leave their chords, over these, shape (Q,)."""
    chords = sides[:, :, -1] - sides[:, :, 0]
    offsets = sides - sides[:, :, :1]
    areas = offsets[..., 0] * chords[:, :, None, 1] - offsets[..., 1] * chords[:, :, None, 0]
    departures = np.abs(areas).max(axis=2) / (chords**2).sum(axis=-1)
    return np.asarray(departures.max(axis=1, initial=0.0))


def residual_bends(rays: FloatArray, sides: FloatArray, focal_lengths: FloatArray) -> FloatArray:
    """Return how far rays leave the planes of their sides' ends, over the chords, shape (F, Q)."""
    normals = np.cross(rays[..., 0, :], rays[..., -1, :])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    angles = np.abs((rays * normals[..., None, :]).sum(axis=-1)).max(axis=-1)
    chords = np.linalg.norm(sides[:, :, -1] - sides[:, :, 0], axis=-1)
    residuals = angles * focal_lengths[:, None, None] / chords
    return np.asarray(residuals.max(axis=-1))
