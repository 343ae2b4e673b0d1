"""The three linear steps of the paper, one by one.

Zhou, Cui, Gao & Wang, Optics and Lasers in Engineering 51 (2013) 1332-1343.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    not_negative,
    real_array,
    size_of_image,
    whole_number,
)
from trisquare.errors import NotEnoughPlanesError


@dataclass(frozen=True, slots=True, eq=False)
class Straightening(RebuiltByConstructor):
    """The map from observed to ideal pixels that makes curves straight.

    ``r_u = r_d (1 + a1 rho^2 + a2 rho^4 + ...)`` about `centre`, with ``rho = r_d / radius``.

    Parameters
    ----------
    coefficients : ndarray, shape (C,)
        ``a1, a2, ...``.
    centre : ndarray, shape (2,)
        Centre of distortion, pixels.
    radius : float
        Half the image diagonal, pixels.
    rms : float
        Root mean square distance of the samples to their lines, in pixels of the photograph.
    """

    coefficients: FloatArray
    centre: FloatArray
    radius: float
    rms: float

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "coefficients", real_array(self.coefficients, "coefficients", (None,))
        )
        object.__setattr__(self, "centre", real_array(self.centre, "centre", (2,)))
        object.__setattr__(self, "radius", not_negative(self.radius, "radius"))
        object.__setattr__(self, "rms", not_negative(self.rms, "rms"))

    def undistort(self, points: npt.ArrayLike) -> FloatArray:
        """Return the ideal places of observed pixels.

        Parameters
        ----------
        points : array_like, shape (N, 2)
            ``(x, y)`` in pixels.

        Returns
        -------
        ndarray, shape (N, 2)

        Raises
        ------
        ValueError
            If a point lies beyond the radius up to which the map is invertible.
        """
        x, y = self.centre.tolist()
        observed = real_array(points, "points", (None, 2))
        return _core.straighten(observed, self.coefficients.tolist(), (x, y), self.radius)

    def __repr__(self) -> str:
        terms = ", ".join(f"{a:.6g}" for a in self.coefficients)
        x, y = self.centre
        return f"<Straightening ({terms}) about ({x:.2f}, {y:.2f}): rms {self.rms:.3g} px>"


def fit_distortion(
    curves: Sequence[npt.ArrayLike],
    image_size: tuple[int, int],
    coefficients: int = 2,
    centre: npt.ArrayLike | None = None,
) -> Straightening:
    """Find the radial distortion that makes all curves straight at once (step 1).

    Minimised is the distance of the samples to the straight lines that fit them best, measured
    back in the distorted picture.

    Parameters
    ----------
    curves : sequence of array_like, shape (N_i, 2), N_i >= 2
        Samples on the images of straight lines, pixels.
    image_size : (int, int)
        Width and height in pixels.
    coefficients : int
        How many, 1 to 3.
    centre : array_like, shape (2,), optional
        Centre of distortion. By default the image centre, or estimated where the curves
        determine it to better than 5 % of the width.

    Raises
    ------
    NotEnoughDataError
        If there are too few samples.
    ConvergenceError
        If the iteration does not settle.
    TypeError, ValueError
        For bad arguments.
    """
    samples = [real_array(curve, f"curve {i}", (None, 2)) for i, curve in enumerate(curves)]
    size = size_of_image(image_size)
    count = whole_number(coefficients, "coefficients")
    if count < 1:
        raise ValueError(f"a straightening has 1 to 3 coefficients, not {count}")
    held = None
    if centre is not None:
        x, y = real_array(centre, "centre", (2,)).tolist()
        held = (x, y)
    found, (x, y), radius, rms = _core.fit_distortion(samples, size, count, held)
    return Straightening(found, np.array([x, y]), radius, rms)


def homography_from_lines(plane_lines: npt.ArrayLike, image_lines: npt.ArrayLike) -> FloatArray:
    """Return ``H_image_from_plane`` from four or more line correspondences (step 2).

    The normalised direct linear transform, ``l_plane x (H^T l_image) = 0`` (Zeng, Deng & Hu,
    Pattern Recognition Letters 29 (2008) 1236-1244).

    Parameters
    ----------
    plane_lines, image_lines : array_like, shape (L, 3), L >= 4
        Lines ``(a, b, c)``, ``a x + b y + c = 0``, at any scale.

    Returns
    -------
    ndarray, shape (3, 3)
        Of unit Frobenius norm.

    Raises
    ------
    NotEnoughDataError
        For fewer than four lines.
    DegenerateGeometryError
        If the lines leave the homography open.
    ValueError
        For unequal numbers, wrong shapes, or values that are not finite.
    """
    return _core.homography_from_lines(
        real_array(plane_lines, "plane_lines", (None, 3)),
        real_array(image_lines, "image_lines", (None, 3)),
    )


def camera_matrix_from_homographies(homographies: npt.ArrayLike) -> FloatArray:
    """Return K from planes, by the image of the absolute conic, without skew (step 3).

    Every plane gives ``h1^T omega h2 = 0`` and ``h1^T omega h1 = h2^T omega h2`` (Hartley &
    Zisserman, 2nd ed., section 8.5).

    Parameters
    ----------
    homographies : array_like, shape (P, 3, 3), P >= 2
        ``H_image_from_plane``, at any scale.

    Returns
    -------
    ndarray, shape (3, 3)
        ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, pixels.

    Raises
    ------
    NotEnoughPlanesError
        For fewer than two planes.
    DegenerateGeometryError
        If the planes are parallel, or contradict each other.
    """
    if len(homographies) == 0:  # type: ignore[arg-type]
        raise NotEnoughPlanesError("no homographies given")
    stack = real_array(homographies, "homographies", (None, 3, 3))
    return _core.camera_matrix_from_homographies(list(stack))


def pose_from_homography(
    K: npt.ArrayLike, homography: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return ``cam_from_plane`` of a plane seen in front of the camera.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        Camera matrix.
    homography : array_like, shape (3, 3)
        ``H_image_from_plane``, at any scale.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
    translation : ndarray, shape (3,)
        In units of the plane; its origin lies in front of the camera.

    Raises
    ------
    DegenerateGeometryError
        If the homography is singular.
    """
    return _core.pose_from_homography(
        real_array(K, "K", (3, 3)), real_array(homography, "homography", (3, 3))
    )
