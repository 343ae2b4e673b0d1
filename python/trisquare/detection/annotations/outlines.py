"""Hand-drawn outlines of squares: coarse, and checked for validity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray, pixel_array

SHORTEST_SIDE = 12.0
"""Minimum side, pixels; what remains of a shorter one between its corners' blur cannot be
measured."""

MAX_POINTS = 200
"""Maximum number of points of a polygon among which its corners are searched, in time that grows
with the square of their number; polygons of more are masks traced pixel by pixel, and lose nothing
by being thinned."""

MAX_JOIN_GAP = 10.0
"""Maximum distance between the end of one drawn side and the start of the next, pixels: two ends
that are each 5 px off."""

MAX_OUTSIDE = 1.0
"""Maximum distance of a point outside the picture, pixels: programs that count from the corner of
the first pixel, not its centre, reach half a pixel further."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedOutline:
    """One closed outline of four sides, within some pixels of the edges.

    Attributes
    ----------
    sides : tuple of four ndarrays of float64, shape (N, 2), N >= 2
        Polylines, clockwise on the screen; in pixels of the photograph as it is stored.
    where : str
        Its name in its file or list; messages begin with it.
    """

    sides: tuple[FloatArray, ...]
    where: str

    @property
    def corners(self) -> FloatArray:
        """Starting points of the sides, shape (4, 2)."""
        return np.array([side[0] for side in self.sides])

    @classmethod
    def of_polygon(cls, points: Any, where: str) -> AnnotatedOutline:
        """Build an outline from four corners, or from a closed polygon whose corners are searched.

        Raises
        ------
        TypeError, ValueError
            If that is not an outline; the message begins with `where`.
        """
        polygon = pixel_array(points, where, (None, 2))
        if len(polygon) > 1 and np.array_equal(polygon[0], polygon[-1]):
            polygon = polygon[:-1]  # closed by a repeated point
        if len(polygon) < 4:
            raise ValueError(f"{where} has {len(polygon)} points: a square needs its 4 corners")
        if len(polygon) > MAX_POINTS:
            polygon = polygon[_thinned_indices(len(polygon))]
        _refuse_crossings(polygon, where)
        polygon = _clockwise(polygon, where)
        corners = np.arange(4) if len(polygon) == 4 else _corners_of(polygon)
        ends = np.append(corners[1:], corners[0] + len(polygon))
        sides = [
            polygon[np.arange(first, last + 1) % len(polygon)]
            for first, last in zip(corners, ends, strict=True)
        ]
        return cls._checked(sides, where)

    @classmethod
    def of_sides(cls, sides: Any, where: str) -> AnnotatedOutline:
        """Build an outline from four polylines, in order round the square, each either way round.

        Raises
        ------
        TypeError, ValueError
            If they make no outline; the message begins with `where`.
        """
        try:
            given = list(sides)
        except TypeError as error:
            raise TypeError(f"{where} must contain four polylines") from error
        if len(given) != 4:
            raise ValueError(f"{where} has {len(given)} sides: a square has 4")
        lines = [pixel_array(side, f"{where}[{i}]", (None, 2)) for i, side in enumerate(given)]
        for i, line in enumerate(lines):
            if len(line) < 2:
                raise ValueError(f"{where}[{i}] has {len(line)} points: a side needs 2 or more")
        lines = _chained_sides(lines, where)
        if _signed_area(np.concatenate(lines)) < 0:
            lines = [line[::-1] for line in lines[::-1]]
        return cls._checked(lines, where)

    @classmethod
    def _checked(cls, sides: list[FloatArray], where: str) -> AnnotatedOutline:
        lengths = [np.hypot(*(side[-1] - side[0])) for side in sides]
        if min(lengths) < SHORTEST_SIDE:
            raise ValueError(
                f"{where} has a side of {min(lengths):.1f} px: it needs {SHORTEST_SIDE:.0f} or more"
            )
        corners = np.array([side[0] for side in sides])
        if not cv2.isContourConvex(corners.astype(np.float32)):
            raise ValueError(f"{where}: its four corners do not make a convex quadrilateral")
        for side in sides:
            side.flags.writeable = False
        return cls(tuple(sides), where)


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedSquare:
    """A drawn square, or a frame with a second outline on the same plane."""

    outer: AnnotatedOutline
    inner: AnnotatedOutline | None = None

    @classmethod
    def of_two(cls, first: AnnotatedOutline, second: AnnotatedOutline) -> AnnotatedSquare:
        """Build a frame from two outlines in either order.

        Raises
        ------
        ValueError
            If neither lies inside the other.
        """
        for outer, inner in ((first, second), (second, first)):
            polygon = outer.corners.astype(np.float32)
            distances = [cv2.pointPolygonTest(polygon, (x, y), False) for x, y in inner.corners]
            if min(distances) > 0:
                return cls(outer, inner)
        raise ValueError(
            f"{first.where} and {second.where} are to be a frame: one must lie inside the other"
        )

    @property
    def kind(self) -> str:
        """Return ``"square"`` or ``"frame"``."""
        return "square" if self.inner is None else "frame"

    @property
    def where(self) -> str:
        """Return its name in its file or list."""
        return self.outer.where

    @property
    def corners(self) -> FloatArray:
        """Corners of the outer outline, shape (4, 2), pixels."""
        return self.outer.corners

    def check_inside(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError if a point lies outside a picture of this width and height."""
        for outline in self.outlines:
            points = np.concatenate(outline.sides)
            is_outside = (points < -MAX_OUTSIDE) | (points > np.array(image_size) - 1 + MAX_OUTSIDE)
            if is_outside.any():
                x, y = points[is_outside.any(axis=1).argmax()]
                raise ValueError(
                    f"{outline.where}: the point ({x:g}, {y:g}) lies outside the picture of "
                    f"{image_size[0]} x {image_size[1]} pixels"
                )

    @property
    def outlines(self) -> tuple[AnnotatedOutline, ...]:
        """Return the outer outline and, for a frame, the inner one."""
        return (self.outer,) if self.inner is None else (self.outer, self.inner)


def _thinned_indices(count: int) -> NDArray[np.intp]:
    """Return `MAX_POINTS` evenly spread indices of `count` points."""
    return np.linspace(0, count, MAX_POINTS, endpoint=False).astype(np.intp)


def _next_values(values: FloatArray) -> FloatArray:
    """Return the value after each one, in a tenth of the time of `np.roll`."""
    return np.concatenate((values[1:], values[:1]))


def _signed_area(polygon: FloatArray) -> float:
    """Return twice the area, positive if the polygon runs clockwise on the screen."""
    x, y = (polygon - polygon.mean(axis=0)).T
    return float(x @ _next_values(y) - y @ _next_values(x))


def _clockwise(polygon: FloatArray, where: str) -> FloatArray:
    area = _signed_area(polygon)
    if area == 0:
        raise ValueError(f"{where} has no area")
    return polygon if area > 0 else polygon[::-1]


def _corners_of(polygon: FloatArray) -> NDArray[np.intp]:
    """Find the four points that enclose the largest area, in order round the polygon.

    The sides of a square bend little: in any polygon that follows them, no other four points
    enclose as much. They are on the convex hull. On each side of a diagonal the point that is
    farthest from it lies where the hull turns past the diagonal's direction.
    """
    centred = (polygon - polygon.mean(axis=0)).astype(np.float32)
    hull = np.sort(cv2.convexHull(centred, returnPoints=False).ravel())
    points = polygon[hull]
    edges = _next_values(points) - points
    angles = np.maximum.accumulate(np.unwrap(np.arctan2(edges[:, 1], edges[:, 0])))
    start, end = np.triu_indices(len(hull), 2)
    diagonals = points[end] - points[start]
    turned = np.arctan2(diagonals[:, 1], diagonals[:, 0]) - angles[start]
    along = angles[start] + turned % (2 * np.pi)
    both_turns = np.append(angles, angles + 2 * np.pi)
    corners = [start, np.searchsorted(both_turns, along), end]
    corners.append(np.searchsorted(both_turns, along + np.pi))
    quads = np.stack(corners, axis=1) % len(hull)
    other_diagonals = points[quads[:, 3]] - points[quads[:, 1]]
    areas = diagonals[:, 0] * other_diagonals[:, 1] - diagonals[:, 1] * other_diagonals[:, 0]
    return np.sort(hull[quads[areas.argmax()]])


def _chained_sides(lines: list[FloatArray], where: str) -> list[FloatArray]:
    """Reverse polylines so that each starts where the one before ends."""

    def gaps(ordered: list[FloatArray]) -> list[float]:
        following = [*ordered[1:], ordered[0]]
        return [
            float(np.hypot(*(next_side[0] - side[-1])))
            for side, next_side in zip(ordered, following, strict=True)
        ]

    variants = []
    for flips in np.ndindex(2, 2, 2, 2):
        variants.append(
            [
                line[::-1] if is_flipped else line
                for is_flipped, line in zip(flips, lines, strict=True)
            ]
        )
    best = min(variants, key=lambda ordered: sum(gaps(ordered)))
    widest = int(np.argmax(gaps(best)))
    if gaps(best)[widest] > MAX_JOIN_GAP:
        raise ValueError(
            f"{where}: sides {widest} and {(widest + 1) % 4} are {gaps(best)[widest]:.0f} px "
            "apart: give the sides in order round the square, corner to corner"
        )
    return best


def _refuse_crossings(polygon: FloatArray, where: str) -> None:
    """Raise ValueError if two edges of a closed polygon cross."""
    start, end = polygon, _next_values(polygon)
    direction = end - start

    def side_of(point: FloatArray) -> FloatArray:
        """Return on which side of every edge i each point j lies, shape (N, N)."""
        relative = point[None] - start[:, None]
        return np.asarray(
            np.sign(
                direction[:, None, 0] * relative[..., 1] - direction[:, None, 1] * relative[..., 0]
            )
        )

    is_separated = side_of(start) * side_of(end) < 0
    if (is_separated & is_separated.T).any():
        raise ValueError(f"{where} crosses itself: give the points in order round the square")
