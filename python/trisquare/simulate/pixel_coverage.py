"""Coverage of each pixel by a flat quadrilateral that is seen through a distorting lens.

Every side is a gently curved line in the picture. Its signed distance is measured to the curve
itself, not to its chord nor in undistorted coordinates, and converted to grey by
`edge_profile`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trisquare.simulate.edge_profile import blurred_step, blurred_wedge
from trisquare.simulate.scene import Array, Side, Target, TrueCamera

# A side is a graph over its chord: degree 13 leaves under 1e-7 px for the design's lenses. Most
# sides need fewer terms; the omitted ones add up to less than `_LEFT_OUT`, pixels.
_DEGREE = 13
_LEFT_OUT = 1e-9
_CURVE_SAMPLES = 64
_FOOT_STEPS = 4
# Newton's next step is the square of this step, pixels; the distance is off by less.
_FOOT_FOUND = 1e-8
# 5.5 standard deviations leave 2e-8 of the step; the pixel's box reaches half its diagonal.
_GAUSSIAN_REACH = 5.5
_PIXEL_HALF_DIAGONAL = 0.71
# A side is continued past its corners, since both sides' lines matter near a corner; three
# reaches suffice for corners down to 20 degrees.
_CONTINUATION = 3.0


class Patch(NamedTuple):
    """A rectangle of the picture and the coverage (0 to 1) of its pixels."""

    rows: slice
    columns: slice
    coverage: Array


class EdgeCurve:
    """The image of one side of a figure, as a graph over its chord.

    The figure is on its right on the screen; it continues `continuation` pixels past both ends.
    """

    def __init__(self, camera: TrueCamera, target: Target, side: Side, continuation: float) -> None:
        ends = camera.project(target.to_camera(np.array([side.start, side.end])))
        length = float(np.hypot(*(ends[1] - ends[0])))
        self.origin = ends[0]
        self.along = (ends[1] - ends[0]) / length
        self.inward = np.array([-self.along[1], self.along[0]])
        margin = continuation / length
        chebyshev = np.cos(np.pi * (np.arange(_CURVE_SAMPLES) + 0.5) / _CURVE_SAMPLES)
        fraction = 0.5 + (0.5 + margin) * chebyshev
        points = camera.project(target.to_camera(side.points(fraction)))
        u, v = (points - self.origin) @ self.along, (points - self.origin) @ self.inward
        self.domain = (float(u.min()), float(u.max()))
        self.bulge = (float(v.min()), float(v.max()))
        self._height = np.polynomial.Chebyshev.fit(u, v, _DEGREE).trim(_LEFT_OUT / _DEGREE)
        self._slope = self._height.deriv()
        self._bend = self._slope.deriv()
        self.points = points

    def signed_distance(self, pixels: Array) -> tuple[Array, Array]:
        """Return distances of pixels, (N, 2), from the curve, (N,), positive inside, and normals.

        These are the curve's inward unit normals at the points nearest to the pixels, shape (N, 2).
        """
        offset = pixels - self.origin
        u_pixel, v_pixel = offset @ self.along, offset @ self.inward
        u = np.clip(u_pixel, *self.domain)
        for _ in range(_FOOT_STEPS):
            gap, slope = self._height(u) - v_pixel, self._slope(u)
            gradient = (u - u_pixel) + gap * slope
            step = gradient / (1.0 + slope**2 + gap * self._bend(u))
            u = np.clip(u - step, *self.domain)
            if np.abs(step).max(initial=0.0) < _FOOT_FOUND:
                break
        height, slope = self._height(u), self._slope(u)
        scale = 1.0 / np.hypot(1.0, slope)
        distance = (v_pixel - height - slope * (u_pixel - u)) * scale
        normal = (self.inward - slope[:, None] * self.along) * scale[:, None]
        return distance, normal


def quadrilateral_coverage(
    camera: TrueCamera, target: Target, sides: list[Side], blur: float
) -> Patch | None:
    """Return the coverage of every pixel by a convex quadrilateral of the target's plane.

    It is blurred with a standard deviation of `blur` pixels; `sides` go clockwise on the screen.
    The patch is the part of the picture where it is not zero; None if there is none.
    """
    reach = _GAUSSIAN_REACH * blur + _PIXEL_HALF_DIAGONAL
    curves = [EdgeCurve(camera, target, side, _CONTINUATION * reach) for side in sides]
    points = np.concatenate([curve.points for curve in curves])
    low = np.maximum(np.floor(points.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + 1, camera.image_size)
    if np.any(low >= high):
        return None
    rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    x, y = np.arange(low[0], high[0]), np.arange(low[1], high[1])
    profiles, distances = zip(
        *(_side_profile(curve, x, y, blur, reach) for curve in curves), strict=True
    )
    # The region between opposite sides. The product would be exact if the distances from
    # neighbouring sides were independent under the blur. The effects of their correlation at the
    # corners add up: in a small cell, all four corners reach every pixel.
    between = [np.maximum(profiles[i] + profiles[i + 2] - 1.0, 0.0) for i in range(2)]
    coverage = between[0] * between[1]
    within = [np.abs(distance) < reach for distance in distances]
    for i in range(4):
        near = within[i - 1] & within[i]
        pixels = _pixels(x, y, near)
        distance1, normal1 = curves[i - 1].signed_distance(pixels)
        distance2, normal2 = curves[i].signed_distance(pixels)
        wedge = blurred_wedge(distance1, distance2, normal1, normal2, blur)
        coverage[near] += wedge - profiles[i - 1][near] * profiles[i][near]
    return Patch(rows, columns, coverage)


def _side_profile(
    curve: EdgeCurve, x: Array, y: Array, blur: float, reach: float
) -> tuple[Array, Array]:
    """Return the grey profile of one side, and the signed distance, infinite out of reach.

    Both are of the pixels of columns x and rows y, of shape (len(y), len(x)).
    """
    from_x, from_y = x - curve.origin[0], (y - curve.origin[1])[:, None]
    u = from_x * curve.along[0] + from_y * curve.along[1]
    v = from_x * curve.inward[0] + from_y * curve.inward[1]
    near = (v > curve.bulge[0] - reach) & (v < curve.bulge[1] + reach)
    near &= (u > curve.domain[0]) & (u < curve.domain[1])
    profile = (v > 0.0).astype(np.float64)
    distance = np.full(v.shape, np.inf)
    distances, normal = curve.signed_distance(_pixels(x, y, near))
    distance[near] = distances
    profile[near] = blurred_step(distances, normal, blur)
    return profile, distance


def _pixels(x: Array, y: Array, chosen: Array) -> Array:
    """Return coordinates, shape (N, 2), of the chosen pixels of columns x and rows y."""
    rows, columns = np.nonzero(chosen)
    return np.stack([x[columns], y[rows]], axis=1)
