"""Uncertainty of a plane's pose, jointly with the camera's."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.records import NUMBER, Record, array, member


@dataclass(frozen=True, slots=True, eq=False)
class PoseUncertainty(Record):
    """Uncertainty of a pose, and its dependence on the camera.

    A pose's parameters are a rotation vector applied after its rotation, in camera coordinates
    (radians), and the translation (units of the square's side). An estimated tone curve counts as
    unknown, like the pose, and depends on the camera like it.

    Parameters
    ----------
    given_camera : array_like, shape (6, 6)
        Covariance of the pose for a given camera.
    by_camera : array_like, shape (6, n)
        Derivative of the pose with respect to all of the camera's parameters, free or fixed, in the
        order ``fx fy cx cy k1 k2 k3 p1 p2``; for a fisheye ``fx fy cx cy k1 k2 k3 k4``; for a
        rational lens ``fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2``, with prism terms also
        ``s1 s2 s3 s4``; ``skew`` comes last if the camera has one or it was free.
    side_error : float, optional
        Root mean square error of the plane's sides beyond their noise, pixels, if there is one
        (paper that is not flat). `measure` assumes the same error for any point of the plane.

    Examples
    --------
    >>> uncertainty = result.planes[0].uncertainty
    >>> std = np.sqrt(np.diag(uncertainty.given_camera))
    >>> print(f"distance along the axis known to {std[5]:.5f} sides")
    distance along the axis known to 0.00007 sides
    """

    given_camera: FloatArray = field(metadata=member(array(6, 6)))
    by_camera: FloatArray = field(metadata=member(array(6, None)))
    side_error: float | None = field(default=None, metadata=member(NUMBER, "side_error_px"))

    def __repr__(self) -> str:
        turn, shift = np.sqrt(np.diag(self.given_camera)).reshape(2, 3).max(axis=1).tolist()
        return f"<PoseUncertainty given the camera: {turn:.2g} rad, {shift:.2g} sides>"
