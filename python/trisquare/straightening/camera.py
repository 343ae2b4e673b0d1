"""A camera whose distortion is known, but not its focal length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    real_array,
    real_number,
    size_of_image,
)
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.camera.lens_models import LensModel
from trisquare.camera.projection_uncertainty import checked_spacing
from trisquare.errors import LensModelError
from trisquare.straightening.radial import FAMILIES, RadialLens

COEFFICIENT_COUNTS = (2, 3)

MAX_MODEL_ERROR = 0.5
"""Maximum difference in pixels between a `Camera` and the lens that it represents."""

COMPARED_RADII = 200

MAP_STEP = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementMap(RebuiltByConstructor):
    """Displacement of pixels by a lens.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Pixels of the photograph.
    displacement : ndarray, shape (N, 2)
        From the ideal position to the observed one, pixels.
    std : ndarray, shape (N, 2)
        Standard deviation of the displacement, pixels.

    Examples
    --------
    >>> shifts = ts.straighten("photo.jpg").camera.displacement_map(step=100)
    >>> shifts.points.shape == shifts.displacement.shape == shifts.std.shape
    True
    """

    points: FloatArray
    displacement: FloatArray
    std: FloatArray

    def __post_init__(self) -> None:
        for name in ("points", "displacement", "std"):
            object.__setattr__(self, name, real_array(getattr(self, name), name, (None, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class UnscaledCamera(RebuiltByConstructor):
    """A camera whose distortion is known, but not its focal length.

    Straight lines determine the displacement of pixels by a lens, but not the angle of a pixel's
    ray. There is no `K`: `camera` makes one with a focal length that is known otherwise. Points and
    pictures need none. With ``q = (pixel - centre) / S`` and `S` half the image diagonal,
    ``q_ideal = q / D``, ``D = 1 + a1 s + a2 s^2 + a3 s^3``.

    Parameters
    ----------
    image_size : (int, int)
        Width and height in pixels.
    family : {"division", "polynomial"}
        Division: ``s = |q|^2`` (A. Fitzgibbon, CVPR 2001). Polynomial: ``s = |q_ideal|^2``, which
        is OpenCV's model in another unit (F. Devernay & O. Faugeras, Machine Vision and
        Applications 13 (2001) 14-24).
    coefficients : array_like, shape (2,) or (3,)
        ``a1, a2``, and ``a3`` unless it is omitted, as zero.
    centre : array_like, shape (2,)
        Centre of the distortion, pixels.
    covariance : array_like, shape (4, 4) or (5, 5)
        Covariance of the coefficients, ``cx`` and ``cy``.

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type or shape, or is not finite.

    Examples
    --------
    >>> size, centre = (1280, 960), (640, 480)
    >>> unscaled = ts.UnscaledCamera(size, "division", [-0.2, 0], centre, np.eye(4))
    >>> unscaled.radius
    800.0
    """

    image_size: tuple[int, int]
    family: str
    coefficients: FloatArray
    centre: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise ValueError(f"family must be one of {FAMILIES}, not {self.family!r}")
        object.__setattr__(self, "image_size", size_of_image(self.image_size))
        for name, shape in (("coefficients", (None,)), ("centre", (2,))):
            object.__setattr__(self, name, real_array(getattr(self, name), name, shape))
        if len(self.coefficients) not in COEFFICIENT_COUNTS:
            raise ValueError(f"coefficients must be two or three, not {len(self.coefficients)}")
        count = len(self.coefficients) + 2
        covariance = real_array(self.covariance, "covariance", (count, count))
        object.__setattr__(self, "covariance", covariance)
        if not _core.is_covariance(self.covariance):
            raise ValueError("covariance must be symmetric and positive semidefinite")

    @property
    def radius(self) -> float:
        """``S``, half the image diagonal, pixels."""
        return 0.5 * float(np.hypot(*self.image_size))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the coefficients, ``cx`` and ``cy``; of the last two in pixels."""
        values = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist()
        return dict(zip(self._names, values, strict=True))

    @property
    def _names(self) -> tuple[str, ...]:
        return (*("a1", "a2", "a3")[: len(self.coefficients)], "cx", "cy")

    @property
    def radial(self) -> RadialLens:
        """The distortion in half diagonals about the centre."""
        return RadialLens(self.family, self.coefficients)

    @property
    def valid_radius_px(self) -> float | None:
        """Distance from the centre within which pixels can be undistorted; None: no limit."""
        largest = self.radial.largest_radius()
        return None if largest == np.inf else largest * self.radius

    def undistort_points(self, observed: npt.ArrayLike) -> FloatArray:
        """Return the positions at which a pinhole would have seen what pixels show.

        Parameters
        ----------
        observed : array_like, shape (N, 2)
            Pixels of the photograph.

        Returns
        -------
        ndarray, shape (N, 2)
            Pixels; the scale at the centre is unchanged.

        Raises
        ------
        ValueError
            If a pixel lies beyond the valid radius.

        Examples
        --------
        >>> size, centre = (1280, 960), (640, 480)
        >>> unscaled = ts.UnscaledCamera(size, "division", [-0.2, 0], centre, np.eye(4))
        >>> unscaled.undistort_points([[640, 480], [100, 80]]).round(1).tolist()
        [[640.0, 480.0], [11.3, 14.3]]
        """
        q = (real_array(observed, "observed", (None, 2)) - self.centre) / self.radius
        square = np.einsum("ij,ij->i", q, q)
        _check_within(np.sqrt(square), self.radial.largest_radius())
        divisor, _, _ = self.radial.divisor(square)
        return np.asarray(self.centre + self.radius * q / divisor[:, None])

    def distort_points(self, ideal: npt.ArrayLike) -> FloatArray:
        """Return the positions at which the lens shows what a pinhole would have seen at pixels.

        The inverse of `undistort_points`.

        Parameters
        ----------
        ideal : array_like, shape (N, 2)
            Pixels.

        Returns
        -------
        ndarray, shape (N, 2)
            Pixels of the photograph.

        Raises
        ------
        ValueError
            If a point lies beyond the ideal valid radius.

        Examples
        --------
        >>> size, centre = (1280, 960), (640, 480)
        >>> unscaled = ts.UnscaledCamera(size, "division", [-0.2, 0], centre, np.eye(4))
        >>> unscaled.distort_points([[640, 480], [10, 14]]).round(1).tolist()
        [[640.0, 480.0], [99.1, 79.9]]
        """
        q = (real_array(ideal, "ideal", (None, 2)) - self.centre) / self.radius
        radii = np.hypot(q[:, 0], q[:, 1])
        _check_within(radii, self.largest_ideal_radius())
        ratio = np.ones_like(radii)
        is_off_centre = radii > 0
        ratio[is_off_centre] = (
            self.radial.observed_radius(radii[is_off_centre]) / radii[is_off_centre]
        )
        return np.asarray(self.centre + self.radius * q * ratio[:, None])

    def largest_ideal_radius(self) -> float:
        """Return the ideal valid radius, half diagonals; infinite if there is no limit.

        Examples
        --------
        >>> size, centre = (1280, 960), (640, 480)
        >>> unscaled = ts.UnscaledCamera(size, "division", [-0.2, 0], centre, np.eye(4))
        >>> round(unscaled.largest_ideal_radius(), 2)
        5.99
        """
        largest = self.radial.largest_radius()
        if largest == np.inf:
            return largest
        return float(self.radial.ideal_radius(np.array([largest]))[0])

    def displacement_map(self, step: float = MAP_STEP) -> DisplacementMap:
        """Return the displacement of pixels by the lens, with standard deviations.

        Parameters
        ----------
        step : float
            Maximum distance of neighbouring points, pixels.

        Raises
        ------
        TypeError, ValueError
            If `step` is not positive.

        Examples
        --------
        >>> size, centre = (1280, 960), (640, 480)
        >>> unscaled = ts.UnscaledCamera(size, "division", [-0.2, 0], centre, np.eye(4))
        >>> unscaled.displacement_map(step=200).points.shape
        (48, 2)
        """
        step = checked_spacing(self.image_size, step)
        axes = [np.linspace(0, side - 1, 2 + int((side - 1) / step)) for side in self.image_size]
        points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        distances = np.linalg.norm(points - self.centre, axis=1)
        points = points[distances < self.radial.largest_radius() * self.radius]
        displacement = points - self.undistort_points(points)
        jacobian = self._jacobian(points)
        variances = np.einsum("pij,jk,pik->pi", jacobian, self.covariance, jacobian)
        return DisplacementMap(points, displacement, np.sqrt(np.maximum(variances, 0.0)))

    def _jacobian(self, points: FloatArray) -> FloatArray:
        """Return derivatives of ideal positions by all parameters; shape (N, 2, C + 2)."""
        q = (points - self.centre) / self.radius
        divisor, slope, by_coefficients = self.radial.divisor(np.einsum("ij,ij->i", q, q))
        along = q[:, :, None] * q[:, None, :]
        by_q = np.eye(2) / divisor[:, None, None]
        by_q = by_q - (2 * slope / divisor**2)[:, None, None] * along
        scaled = -self.radius * q / divisor[:, None] ** 2
        by_a = scaled[:, :, None] * by_coefficients[:, None, :]
        return np.concatenate([by_a, np.eye(2) - by_q], axis=2)

    def camera(self, focal_length: float) -> Camera:
        """Return the camera with this distortion and a focal length.

        Parameters
        ----------
        focal_length : float
            In pixels, which are square.

        Returns
        -------
        Camera
            "radial2" or "radial3" for a polynomial, which are exact. For the division model
            "radial3", or "fisheye" (of ``cv2.fisheye``) if "radial3" is more than half a pixel off
            anywhere in the picture.

        Raises
        ------
        LensModelError
            A ValueError, if the nearest model differs by more than half a pixel anywhere.
        TypeError, ValueError
            If `focal_length` is not positive.

        Examples
        --------
        >>> size, centre = (1280, 960), (640, 480)
        >>> unscaled = ts.UnscaledCamera(size, "polynomial", [-0.1, 0], centre, np.eye(4))
        >>> unscaled.camera(focal_length=900).K.tolist()
        [[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]]
        """
        focal = real_number(focal_length, "focal_length")
        if focal <= 0:
            raise ValueError(f"focal_length must be positive, not {focal}")
        K = camera_matrix(focal, focal, *self.centre.tolist())
        unit = focal / self.radius
        if self.family == "polynomial":
            k1, k2, k3 = np.append(self.coefficients, 0.0)[:3] * unit ** np.array([2, 4, 6])
            polynomial: LensModel = "radial2" if k3 == 0 else "radial3"
            return Camera(K, np.array([k1, k2, 0, 0, k3]), self.image_size, polynomial)
        corners = np.array(self.image_size) * [[0, 0], [0, 1], [1, 0], [1, 1]] - self.centre
        farthest = np.linalg.norm(corners, axis=1).max() / self.radius
        end = min(float(farthest), self.radial.largest_radius())
        observed = np.linspace(0, end, COMPARED_RADII + 1)[1:]
        ideal = self.radial.ideal_radius(observed) / unit
        seen = observed / unit
        candidates = [
            _fitted(model, radii, seen) for model, radii in _polynomial_radii(ideal).items()
        ]
        errors = [np.abs(residuals) * focal for _, _, residuals in candidates]
        close_indices = [i for i, error in enumerate(errors) if error.max() <= MAX_MODEL_ERROR]
        best = (
            close_indices[0] if close_indices else int(np.argmin([error.max() for error in errors]))
        )
        model, k, _ = candidates[best]
        distortion = k if model == "fisheye" else np.array([k[0], k[1], 0, 0, k[2]])
        nearest = Camera(K, distortion, self.image_size, model)
        worst = float(errors[best].max())
        if worst > MAX_MODEL_ERROR:
            raise LensModelError(
                f"no lens model has this distortion at a focal length of {focal:.6g} px: the "
                f"nearest, {model}, is {worst:.2g} px off",
                nearest,
                float(np.sqrt(np.mean(errors[best] ** 2))),
                worst,
            )
        return nearest

    def __repr__(self) -> str:
        width, height = self.image_size
        values = zip(self._names, (*self.coefficients, *self.centre), strict=True)
        numbers = ", ".join(f"{name} {value:.5g}" for name, value in values)
        return f"<UnscaledCamera {width} x {height}, {self.family}: {numbers}>"


def _polynomial_radii(ideal: FloatArray) -> dict[LensModel, FloatArray]:
    """Return the radius in which each model's distortion is a polynomial."""
    return {"radial3": ideal, "fisheye": np.arctan(ideal)}  # the first that is close is taken


def _fitted(
    model: LensModel, radii: FloatArray, seen: FloatArray
) -> tuple[LensModel, FloatArray, FloatArray]:
    """Fit a model's coefficients by linear least squares; return them and the residuals."""
    powers = (3, 5, 7, 9) if model == "fisheye" else (3, 5, 7)
    design = np.column_stack([radii**power for power in powers])
    size = design.max(axis=0)
    k = np.linalg.lstsq(design / size, seen - radii, rcond=None)[0] / size
    return model, k, design @ k - (seen - radii)


def _check_within(radii: FloatArray, largest: float) -> None:
    beyond = np.nonzero(radii > largest * (1 + 1e-12))[0]
    if len(beyond):
        raise ValueError(
            f"{len(beyond)} of {len(radii)} points lie beyond the valid radius, the first at "
            f"index {beyond[0]}"
        )
