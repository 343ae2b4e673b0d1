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
    sequence,
    size_of_image,
    whole_number,
)
from trisquare.edges import LEAVE_OUT
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

    Examples
    --------
    >>> along = np.linspace(100, 1180, 50)
    >>> lines = [np.column_stack([along, np.full(50, y)]) for y in (100.0, 480.0, 860.0)]
    >>> bool(abs(ts.fit_distortion(lines, (1280, 960)).coefficients).max() < 1e-6)
    True
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

        Examples
        --------
        >>> straightening = ts.Straightening(np.array([0.1]), np.array([640, 480]), 800.0, 0.0)
        >>> straightening.undistort([[640, 480], [1280, 960]]).tolist()
        [[640.0, 480.0], [1344.0, 1008.0]]
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

    It minimises the distances of the samples to the straight lines that fit them best, measured in
    the distorted picture.

    Parameters
    ----------
    curves : sequence of array_like, shape (N_i, 2), N_i >= 2
        Samples on the images of straight lines, pixels.
    image_size : (int, int)
        Width and height in pixels.
    coefficients : int
        Number of coefficients, 1 to 3.
    centre : array_like, shape (2,), optional
        Centre of distortion. By default the image centre, or estimated where the curves
        determine it to better than 5 % of the width.

    Raises
    ------
    NotEnoughDataError
        If there are too few samples.
    ConvergenceError
        If the iteration does not converge.
    TypeError, ValueError
        For bad arguments.

    Examples
    --------
    >>> x = np.linspace(100, 1180, 50)
    >>> curves = [  # lines that bend outward, the more the farther they are from the centre
    ...     np.column_stack([x, y - (y - 480) * 1e-7 * (x - 640) ** 2])
    ...     for y in (100, 300, 700, 860)
    ... ]
    >>> straightening = ts.fit_distortion(curves, (1280, 960), coefficients=1)
    >>> print(f"a1 {straightening.coefficients[0]:.2f}")
    a1 0.07
    """
    samples = [
        real_array(curve, f"curve {i}", (None, 2), LEAVE_OUT)
        for i, curve in enumerate(sequence(curves, "curves", "arrays, one per curve"))
    ]
    size = size_of_image(image_size)
    count = whole_number(coefficients, "coefficients")
    if not 1 <= count <= 3:
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
        Unit Frobenius norm.

    Raises
    ------
    NotEnoughDataError
        For fewer than four lines.
    DegenerateGeometryError
        If the lines do not determine the homography.
    ValueError
        For unequal numbers, wrong shapes, or values that are not finite.

    Examples
    --------
    >>> unit_square = [[0, 1, 0.5], [-1, 0, 0.5], [0, -1, 0.5], [1, 0, 0.5]]
    >>> seen = [[0, 1, -100], [-1, 0, 300], [0, -1, 300], [1, 0, -100]]  # 200 pixels wide
    >>> x, y, w = ts.homography_from_lines(unit_square, seen) @ [0.5, 0.5, 1]
    >>> print(f"its corner is at ({x / w:.0f}, {y / w:.0f})")
    its corner is at (300, 300)
    """
    return _core.homography_from_lines(
        real_array(plane_lines, "plane_lines", (None, 3)),
        real_array(image_lines, "image_lines", (None, 3)),
    )


def camera_matrix_from_homographies(homographies: npt.ArrayLike) -> FloatArray:
    """Return K, without skew, from planes by the image of the absolute conic (step 3).

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

    Examples
    --------
    >>> K = np.array([[900, 0, 640], [0, 900, 480], [0, 0, 1]])
    >>> homographies = []
    >>> for angle in (0, 2, 4):  # three planes, tilted by 35 degrees about axes apart
    ...     x, y, sine, cosine = np.cos(angle), np.sin(angle), np.sin(0.6), np.cos(0.6)
    ...     r1 = [cosine + x * x * (1 - cosine), x * y * (1 - cosine), -y * sine]
    ...     r2 = [x * y * (1 - cosine), cosine + y * y * (1 - cosine), x * sine]
    ...     homographies.append(K @ np.column_stack([r1, r2, [0.1, 0.1, 3]]))
    >>> ts.camera_matrix_from_homographies(homographies).round(6).tolist()
    [[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]]
    """
    given = sequence(homographies, "homographies", "3 x 3 matrices")
    if not given:
        raise NotEnoughPlanesError("no homographies given")
    stack = real_array(given, "homographies", (None, 3, 3))
    return _core.camera_matrix_from_homographies(list(stack))


def pose_from_homography(
    K: npt.ArrayLike, homography: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return ``cam_from_plane`` of a plane in front of the camera.

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

    Examples
    --------
    >>> K = np.array([[900, 0, 640], [0, 900, 480], [0, 0, 1]])
    >>> homography = K @ np.column_stack([[1, 0, 0], [0, 1, 0], [0.1, 0.2, 3]])
    >>> rotation, translation = ts.pose_from_homography(K, homography)
    >>> translation.round(9).tolist()
    [0.1, 0.2, 3.0]
    """
    return _core.pose_from_homography(
        real_array(K, "K", (3, 3)), real_array(homography, "homography", (3, 3))
    )
