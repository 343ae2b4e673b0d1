"""Lenses that other programs' files may hold and a `Camera` may not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera

Distortion = Callable[[FloatArray], FloatArray]
"""Ideal normalised points, shape (N, 2), to observed normalised ones."""

# Newton's steps: they double the digits once near, and a lens of 170 degrees takes some twenty to
# come near.
MOST_STEPS = 60
# Normalised; a thousandth of a millionth of a pixel for any focal length in use.
SOLVED = 1e-12
ROUNDED = 1e-9
DIFFERENCE = 1e-6
# Where along the way from the axis the lens is checked not to fold back.
PLACES_ON_THE_WAY = np.linspace(0.1, 1.0, 10)


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLens:
    """A camera of a model that `Camera` has not.

    Parameters
    ----------
    title : str
        What it is, for messages: ``"OpenCV's rational model"``.
    K : ndarray, shape (3, 3)
        As `Camera.K`; ``(0, 0)`` is the centre of the top-left pixel.
    image_size : (int, int)
        Width and height in pixels.
    distort : callable
        Ideal normalised points to observed ones, before K.
    """

    title: str
    K: FloatArray
    image_size: tuple[int, int]
    distort: Distortion

    def __post_init__(self) -> None:
        Camera(self.K, np.zeros(5), self.image_size)  # says what is wrong with K or the size

    def directions(self, pixels: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Return the ideal normalised points seen at pixels, and at which there is one.

        By Newton's method; a pixel to which it does not lead, or whose point lies beyond a fold of
        the distortion, has none.
        """
        wanted = (pixels - self.K[:2, 2]) / self.K.diagonal()[:2]
        with np.errstate(all="ignore"):
            found = _solve(self.distort, wanted)
            error = np.abs(self.distort(found) - wanted).max(axis=1)
            known = np.isfinite(found).all(axis=1)
            known &= error < ROUNDED * (1 + np.abs(wanted).max(axis=1))
            for part in PLACES_ON_THE_WAY:
                known &= np.linalg.det(_jacobian(self.distort, part * found)) > 0
        return found, known


def camera_of(
    focal: Sequence[float],
    centre: Sequence[float],
    coefficients: Mapping[str, float],
    image_size: tuple[int, int],
) -> Camera:
    """Make a camera of the simplest model that has all coefficients that are not zero.

    Parameters
    ----------
    focal, centre : (float, float)
        ``fx, fy`` and ``cx, cy``, pixels, counted from the centre of the top-left pixel.
    coefficients : mapping of str to float
        Of ``k1 k2 p1 p2 k3``; those that are missing are zero.
    image_size : (int, int)
        Width and height.
    """
    k1, k2, p1, p2, k3 = (coefficients.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3"))
    if p1 or p2:
        model = "brown"
    else:
        model = "radial3" if k3 else "radial2" if k2 else "radial1" if k1 else "none"
    return Camera(
        camera_matrix(focal, centre),
        np.array([k1, k2, p1, p2, k3]),
        image_size,
        model,
    )


def camera_matrix(focal: Sequence[float], centre: Sequence[float]) -> FloatArray:
    """Return K of ``(fx, fy)`` and ``(cx, cy)``."""
    return np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])


def opencv_lens(
    focal: Sequence[float],
    centre: Sequence[float],
    coefficients: Sequence[float],
    image_size: tuple[int, int],
) -> Camera | ForeignLens:
    """Make a camera of OpenCV's coefficients, in its order; the higher ones may vanish.

    Parameters
    ----------
    focal, centre : (float, float)
        Pixels.
    coefficients : sequence of float
        ``(k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]])``: 0, 2, 4, 5, 8, 12 or
        14 of them.
    image_size : (int, int)
        Width and height.
    """
    values = [float(value) for value in coefficients]
    if any(values[5:]):
        parts = {8: "rational", 12: "thin-prism", 14: "tilted-sensor"}
        dist = np.array(values)
        return ForeignLens(
            f"OpenCV's {parts[len(values)]} model",
            camera_matrix(focal, centre),
            image_size,
            lambda ideal: _distorted_by_opencv(ideal, dist),
        )
    named = dict(zip(("k1", "k2", "p1", "p2", "k3"), values, strict=False))
    return camera_of(focal, centre, named, image_size)


def fisheye_lens(
    title: str,
    focal: Sequence[float],
    centre: Sequence[float],
    coefficients: Sequence[float],
    image_size: tuple[int, int],
) -> ForeignLens:
    """Make a lens whose observed radius is a polynomial of the angle (Kannala & Brandt).

    ``r = theta (1 + k1 theta^2 + k2 theta^4 + ...)``, what OpenCV's ``fisheye``, Kalibr's
    ``equidistant`` and COLMAP's ``OPENCV_FISHEYE`` share.
    """
    polynomial = np.array([1.0, *coefficients])

    def distort(ideal: FloatArray) -> FloatArray:
        radius = np.linalg.norm(ideal, axis=1)
        angle = np.arctan(radius)
        seen = angle * np.polynomial.polynomial.polyval(angle**2, polynomial)
        scale = np.where(radius > 0, seen / np.where(radius > 0, radius, 1.0), 1.0)
        return np.asarray(ideal * scale[:, None])

    return ForeignLens(title, camera_matrix(focal, centre), image_size, distort)


def _distorted_by_opencv(ideal: FloatArray, coefficients: FloatArray) -> FloatArray:
    points = np.column_stack([ideal, np.ones(len(ideal))])
    none = np.zeros(3)
    return np.asarray(cv2.projectPoints(points, none, none, np.eye(3), coefficients)[0][:, 0])


def _solve(distort: Distortion, wanted: FloatArray) -> FloatArray:
    """Newton's method from the observed points themselves, halving the steps that lead away."""
    found = wanted.copy()
    error = distort(found) - wanted
    step_size = np.ones(len(found))
    for _ in range(MOST_STEPS):
        if np.all(np.abs(error) < SOLVED):
            break
        jacobian = _jacobian(distort, found)
        regular = np.abs(np.linalg.det(jacobian)) > SOLVED
        jacobian[~regular] = np.eye(2)
        step = np.linalg.solve(jacobian, error[..., None])[..., 0]
        tried = found - step_size[:, None] * step
        tried_error = distort(tried) - wanted
        better = np.linalg.norm(tried_error, axis=1) < np.linalg.norm(error, axis=1)
        found = np.where(better[:, None], tried, found)
        error = np.where(better[:, None], tried_error, error)
        step_size = np.where(better, np.minimum(1.0, 2.0 * step_size), 0.5 * step_size)
    return found


def _jacobian(distort: Distortion, points: FloatArray) -> FloatArray:
    """Central differences, shape (N, 2, 2): rows are the observed coordinates."""
    columns = []
    for axis in np.eye(2):
        shift = DIFFERENCE * axis
        columns.append((distort(points + shift) - distort(points - shift)) / (2 * DIFFERENCE))
    return np.stack(columns, axis=-1)
