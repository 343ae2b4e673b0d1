"""The angle between two planes of a calibration."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

import trisquare._core as _core
from trisquare._support.number_text import plus_minus
from trisquare._support.suggestions import advising
from trisquare.camera.camera import Camera
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane
from trisquare.results.uncertain_camera import uncertain_camera

__all__ = ["PlaneAngle", "plane_angle"]


class PlaneAngle(NamedTuple):
    """The angle between two planes, and its standard deviation.

    Attributes
    ----------
    degrees : float
        Angle between the normals of the sides that the camera sees, 0 to 180: 90 for two walls of a
        right-angled room, near 0 for parallel planes.
    std : float
        One standard deviation, degrees. For nearly parallel planes, whose angle is never negative,
        it is that of their tilt: if the angle is a few of them or less, the planes may be parallel.
        It is 0 for planes whose angle was fixed by ``orthogonal`` or ``parallel``.

    Examples
    --------
    >>> print(ts.plane_angle(result.planes[0], result.planes[1], result))
    57.2884 +- 0.0049 degrees
    """

    degrees: float
    std: float

    def __str__(self) -> str:
        if self.std == 0.0:
            return f"{self.degrees:.4g} degrees, fixed"
        return f"{plus_minus(self.degrees, self.std)} degrees"


@advising("plane_angle(result.planes[0], result.planes[1], result)")
def plane_angle(one: Plane, other: Plane, camera: Calibration | Camera) -> PlaneAngle:
    """Return the angle between two planes of one picture, and its standard deviation.

    Parameters
    ----------
    one, other : Plane
        Planes of a `Calibration`, seen in the same picture, or results of `locate` for one picture.
    camera : Calibration or Camera
        The calibration that the planes belong to, or the camera that they were located with. A
        `Camera` is taken as exact.

    Returns
    -------
    PlaneAngle
        The standard deviation includes the uncertainty of the poses and of the camera, jointly,
        and assumes flat planes. If other pairs of planes were fixed by ``orthogonal`` or
        ``parallel``, this is not taken into account, and it is too large.

    Raises
    ------
    TypeError, ValueError
        For bad arguments; if the planes are of different pictures, between which the camera may
        have moved; if the result of an older version does not state the uncertainty of its poses.

    Examples
    --------
    >>> angle, std = ts.plane_angle(result.planes[0], result.planes[1], result)
    >>> print(f"{angle:.1f} degrees, known to {std:.3f}")
    57.3 degrees, known to 0.005
    """
    for name, plane in (("one", one), ("other", other)):
        if not isinstance(plane, Plane):
            kind = type(plane).__name__
            raise TypeError(f"{name} must be a Plane, such as result.planes[0], not {kind}")
    if one.image != other.image:
        raise ValueError(
            f"the planes are of different pictures, {one.image} and {other.image}: the camera's "
            "pose in one of them relative to the other is not known"
        )
    uncertainties = [plane.uncertainty for plane in (one, other) if plane.uncertainty is not None]
    if len(uncertainties) < 2:
        raise ValueError(
            "the pose of a plane has no uncertainty: calibrate again with this version"
        )
    angle, std = _core.angle_between_planes(
        uncertain_camera(camera),
        [one.rotation, other.rotation],
        [
            (pose_uncertainty.given_camera, pose_uncertainty.by_camera)
            for pose_uncertainty in uncertainties
        ],
    )
    is_held = isinstance(camera, Calibration) and _are_held(one, other, camera)
    return PlaneAngle(math.degrees(angle), 0.0 if is_held else math.degrees(std))


def _are_held(one: Plane, other: Plane, calibration: Calibration) -> bool:
    """Return whether the angle between two planes of a calibration was fixed."""
    planes = calibration.planes
    return any(
        _is_same(planes[first], a) and _is_same(planes[second], b)
        for first, second in (*calibration.orthogonal, *calibration.parallel)
        for a, b in ((one, other), (other, one))
    )


def _is_same(plane: Plane, other: Plane) -> bool:
    """Return whether two planes have the same pose: they may come from copies of one result."""
    is_same_rotation = np.array_equal(plane.rotation, other.rotation)
    return is_same_rotation and np.array_equal(plane.translation, other.translation)
