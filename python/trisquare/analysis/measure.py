"""Lengths, angles and areas on the plane of a square.

A pixel's ray meets the plane in a point, and lengths between such points are relative to the stated
side of the square. This is the paper's own test of a calibration (Zhou, Cui, Gao & Wang, Optics and
Lasers in Engineering 51 (2013) 1332-1343, section 4). The standard deviations include the
contributions of the pixels, the pose and the camera, jointly: a length beside the square has a
smaller relative error than the focal length, since the errors of pose and camera are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    not_negative,
    real_array,
)
from trisquare._support.json_members import dump_members
from trisquare._support.lengths import length_in
from trisquare._support.number_text import plus_minus
from trisquare._support.suggestions import advising
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.camera.camera_of import camera_of
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane
from trisquare.results.uncertain_camera import uncertain_camera

__all__ = ["Measurement", "measure"]

MEASUREMENT_FORMAT = "trisquare-measurement/1"

CLICKED_STD = 0.5
"""Standard deviation (px) of a position clicked in a picture."""

RELATIVE_STEP = 1e-6
"""Step of numerical derivatives, relative to the extent of the points: six digits are right."""

SMALLEST = 1e-9
"""Smallest extent of the points in that step, so that it is not zero for coinciding points."""

LARGEST = 1e100
"""Upper limit of sides and standard deviations, whose squares must not overflow."""

FAR = 2.0
"""Extrapolation above which a warning is given."""

FULL_TURN = 360.0
"""A full turn, degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Measurement(RebuiltByConstructor):
    """Points on a plane, and the lengths, angles and area between them.

    Lengths are in the unit of `measure`: metres if the side is a text such as ``"84mm"`` or the
    plane's own, the unit of the side if it is a number, and sides if no side is known. Angles are
    in degrees.

    Parameters
    ----------
    points : array_like, shape (N, 2)
        Coordinates on the plane: origin at the square's centre, X along its side 0.
    covariance : array_like, shape (2 N, 2 N)
        Covariance of ``x0, y0, x1, y1, ...``.
    extrapolation : float, optional
        Distance of the farthest point from the centre of the plane's figure, over that of the
        figure's corners; None if these are unknown. For values far above 1, lengths are right only
        if the plane is flat up to the point and the point is on it.
    unit : str
        Unit of lengths: ``"m"``, ``"sides"``, or empty if the side is a number of any unit.

    Examples
    --------
    >>> corner = [[150, 120], [400, 150], [390, 400]]
    >>> found = ts.measure(result.planes[0], corner, result, side=84)
    >>> print(f"{found.angles[0]:.0f} degrees, {found.area:.0f} square millimetres")
    97 degrees, 1878 square millimetres
    """

    # No annotation, which would add it to `__dataclass_fields__`.
    other_names = MappingProxyType(
        {"length": "lengths", "std": "lengths_std", "warnings": "extrapolation"}
    )

    points: FloatArray
    covariance: FloatArray
    extrapolation: float | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        if self.extrapolation is not None:
            not_negative(self.extrapolation, "extrapolation")
        points = real_array(self.points, "points", (None, 2))
        shape = (points.size, points.size)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "covariance", real_array(self.covariance, "covariance", shape))

    @property
    def lengths(self) -> FloatArray:
        """Distances from each point to the next, shape (N - 1,)."""
        return _lengths(self.points)

    @property
    def lengths_std(self) -> FloatArray:
        """One standard deviation of each length."""
        return self._std(_lengths)

    @property
    def angles(self) -> FloatArray:
        """Angles at all points but the first and the last, degrees, 0 to 180, shape (N - 2,)."""
        return np.asarray(np.abs(_turns(self.points)))

    @property
    def angles_std(self) -> FloatArray:
        """One standard deviation of each angle, degrees."""
        return self._std(_turns, period=FULL_TURN)

    @property
    def area(self) -> float | None:
        """Area of the polygon of the points; None for fewer than three, or if its sides cross."""
        return abs(float(_signed_area(self.points)[0])) if _is_polygon(self.points) else None

    @property
    def area_std(self) -> float | None:
        """One standard deviation of the area."""
        return float(self._std(_signed_area)[0]) if _is_polygon(self.points) else None

    def members(self) -> dict[str, Any]:
        """Return the measurement as a JSON object.

        `trisquare measure --json` adds plane and warnings.

        Examples
        --------
        >>> ts.measure(result.planes[0], [[150, 120], [400, 150]], result).members()["unit"]
        'sides'
        """
        return {
            "format": MEASUREMENT_FORMAT,
            "unit": self.unit,
            "points": self.points.tolist(),
            "covariance": self.covariance.tolist(),
            "lengths": self.lengths.tolist(),
            "lengths_std": self.lengths_std.tolist(),
            "angles": self.angles.tolist(),
            "angles_std": self.angles_std.tolist(),
            "area": self.area,
            "area_std": self.area_std,
            "extrapolation": self.extrapolation,
        }

    def to_json(self) -> str:
        """Return `members` as JSON text.

        Examples
        --------
        >>> import json
        >>> corner = [[150, 120], [400, 150], [390, 400]]
        >>> found = ts.measure(result.planes[0], corner, result, side="84mm")
        >>> json.loads(found.to_json())["unit"]
        'm'
        """
        return dump_members(self.members())

    def _std(
        self, of_points: Callable[[FloatArray], FloatArray], period: float | None = None
    ) -> FloatArray:
        """Propagate the covariance to a smooth function of the points, which may be periodic."""
        step = RELATIVE_STEP * max(float(np.ptp(self.points, axis=0).max()), SMALLEST)
        columns = []
        for shift in step * np.eye(self.points.size):
            moved = shift.reshape(self.points.shape)
            change = of_points(self.points + moved) - of_points(self.points - moved)
            columns.append(change if period is None else change - period * np.rint(change / period))
        jacobian = np.stack(columns, axis=-1) / (2 * step)
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def __repr__(self) -> str:
        length_texts = [
            f"{plus_minus(length, std)} {self.unit}".rstrip()
            for length, std in zip(self.lengths, self.lengths_std, strict=True)
        ]
        return f"<Measurement of {len(self.points)} points: lengths {', '.join(length_texts)}>"


@advising("measure(result.planes[0], points, result)")
def measure(
    plane: Plane,
    points: npt.ArrayLike,
    camera: Calibration | Camera,
    *,
    side: str | float | None = None,
    point_std: float = CLICKED_STD,
) -> Measurement:
    """Measure lengths, angles and the area between points on the plane.

    Parameters
    ----------
    plane : Plane
        Plane of a `Calibration`, or from `locate`.
    points : array_like, shape (N, 2)
        Pixels of the photograph, two or more; in order round a polygon for its area.
    camera : Calibration or Camera
        The calibration that the plane belongs to, or the camera that it was located with. A
        `Camera` is taken as exact.
    side : str or float, optional
        Length of the square's side (of a board: of a cell; of "a4" and the like: the shorter one,
        see `Plane`): a text such as ``"84mm"``, with lengths in metres, or a number in any unit,
        with lengths in that unit. By default the plane's own `side` in metres, or 1 if it is
        unknown.
    point_std : float
        One standard deviation of each pixel's coordinates; half a pixel is typical of pointing by
        hand. `cv2.cornerSubPix` is better only at crossings of a chessboard: at the corner of a
        square or frame it is off by half a pixel. The squares' own corners are known:
        ``plane.corners``.

    Returns
    -------
    Measurement
        Has ``lengths``, ``angles`` and ``area``, and their standard deviations, which include
        the uncertainty of the pixels, the pose and the camera. If the sides of the plane are bent,
        the deviation of the sides (the pose's `side_error`) is added in quadrature to each point's
        standard deviation: 87 to 92 % of the 95 % intervals between crossings of real boards then
        contain the true length. A bend of the plane beyond that of its sides, and errors of a
        camera's fixed parameters, are not included.

    Raises
    ------
    TypeError, ValueError
        For bad arguments; if a point is outside the picture or the valid radius, beyond the
        plane's horizon, or the same as the one before (messages count points from 1); if the
        result of an older version does not state the uncertainty of its poses.

    Examples
    --------
    >>> found = ts.measure(result.planes[0], [[150, 120], [400, 400]], result, side=84)
    >>> print(f"{found.lengths[0]:.1f} +- {found.lengths_std[0]:.1f} mm")
    93.8 +- 0.2 mm
    """
    if not isinstance(plane, Plane):
        raise TypeError(
            f"plane must be a Plane, such as result.planes[0], not {type(plane).__name__}"
        )
    pixels = real_array(points, "points", (None, 2))
    if len(pixels) < 2:
        raise ValueError(f"a length needs two points or more, not {len(pixels)}")
    stated = length_in("m", side, "side")
    length = plane.stated_side if stated is None else stated
    if not length < LARGEST:
        raise ValueError(f"side must be positive and less than {LARGEST:g}, not {length:g}")
    lens = camera_of(camera)
    check_inside(pixels, lens.image_size)
    together = ~np.diff(pixels, axis=0).any(axis=1)
    if together.any():
        number = 1 + int(np.argmax(together))
        raise ValueError(f"points {number} and {number + 1} are the same: they have no length")
    noise = not_negative(point_std, "point_std")
    if noise >= LARGEST:
        raise ValueError(f"point_std must be less than {LARGEST:g} px, not {noise:g}")
    if plane.uncertainty is None:
        raise ValueError("the plane's pose has no uncertainty: calibrate again with this version")
    uncertain = uncertain_camera(camera)
    try:
        found, covariance = _core.points_on_plane_with_covariance(
            uncertain,
            (plane.rotation, plane.translation),
            (plane.uncertainty.given_camera, plane.uncertainty.by_camera),
            pixels,
            math.hypot(noise, plane.uncertainty.side_error or 0.0),
        )
    except ValueError as error:
        _name_unmet_point(pixels, plane, lens, error)
        raise
    reach = _extrapolation(found, plane, lens)
    return Measurement(length * found, length**2 * covariance, reach, _unit(side, plane))


def _unit(side: str | float | None, plane: Plane) -> str:
    """Return the unit of lengths on a plane, as in `Measurement`."""
    if side is None:
        return "sides" if plane.side is None else "m"
    return "m" if isinstance(side, str) else ""


def check_inside(points: FloatArray, image_size: tuple[int, int]) -> None:
    """Refuse pixels, shape (N, 2), outside the picture.

    Raises
    ------
    ValueError
        With the number, counted from 1, of the first one.
    """
    width, height = image_size
    outside = np.any((points < -0.5) | (points > np.array([width, height]) - 0.5), axis=1)
    if outside.any():
        named = _point_named(int(np.argmax(outside)), points)
        raise ValueError(f"{named}, is outside the picture of {width} x {height}")


def _point_named(index: int, points: FloatArray) -> str:
    x, y = points[index]
    return f"point {index + 1}, ({x:g}, {y:g})"


def _name_unmet_point(pixels: FloatArray, plane: Plane, camera: Camera, cause: ValueError) -> None:
    """Raise an error that names the first point, if any, whose ray does not meet the plane."""
    lens, pose = camera_for_core(camera), (plane.rotation, plane.translation)
    for index, pixel in enumerate(pixels):
        try:
            _core.unproject_pixels(lens, pixel[None])
        except ValueError:
            where = "beyond the lens's valid radius"
        else:
            try:
                _core.points_on_plane(lens, pose, pixel[None])
            except ValueError:
                where = "at or beyond the plane's horizon"
            else:
                continue
        raise ValueError(f"{_point_named(index, pixels)}, is {where}") from cause


def extrapolation_on(plane: Plane, pixels: FloatArray, camera: Camera) -> float:
    """Return the `extrapolation` of pixels on a plane; infinity if they cannot be on it."""
    try:
        pose = plane.rotation, plane.translation
        points = _core.points_on_plane(camera_for_core(camera), pose, pixels)
    except ValueError:
        return math.inf
    reach = _extrapolation(points, plane, camera)
    return math.inf if reach is None else reach


def _extrapolation(points: FloatArray, plane: Plane, camera: Camera) -> float | None:
    """Return the maximum distance of points from the figure's centre, over that of its corners."""
    pose = plane.rotation, plane.translation
    try:
        corners = _core.points_on_plane(camera_for_core(camera), pose, plane.corners)
    except ValueError:
        return None  # a plane made by hand, whose corners are not consistent with it
    middle = corners.mean(axis=0)
    reach = float(np.linalg.norm(corners - middle, axis=1).max())
    return float(np.linalg.norm(points - middle, axis=1).max()) / reach if reach > 0 else None


def _lengths(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))


def _turns(points: FloatArray) -> FloatArray:
    """Return the angles with their signs, which are smooth also where three points are in line."""
    before, after = points[:-2] - points[1:-1], points[2:] - points[1:-1]
    return np.asarray(np.degrees(np.arctan2(_cross(before, after), (before * after).sum(axis=1))))


def _is_polygon(points: FloatArray) -> bool:
    """Return whether the points are the corners of a polygon whose sides do not cross."""
    ends = np.roll(points, -1, axis=0)
    # Row i: the starts of all sides lie to the left (+) or right (-) of side i.
    sides = np.sign(_cross((ends - points)[:, None], points[None] - points[:, None]))
    parts = sides * np.roll(sides, -1, axis=1) < 0.0
    return len(points) > 2 and not (parts & parts.T).any()


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _signed_area(points: FloatArray) -> FloatArray:
    """Return a polygon's area (the shoelace formula) with its sense, shape (1,)."""
    x, y = points.T
    return np.array([0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))])
