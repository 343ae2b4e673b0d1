"""The nearest lens of a family that a file format can hold, and how far off it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import Camera, camera_for_core, camera_parameters
from trisquare.formats.other_lenses import ForeignLens, camera_of

# Lines of the grid over the picture's longer side: enough for polynomials of the 7th degree, and
# the borders, where lenses differ most, are among them.
GRID_LINES = 41
# Parts of the picture that must have a direction at all before a lens can be fitted to it.
LEAST_SEEN = 0.5
MOST_STEPS = 200
# The sum of squares is known to this part of itself; smaller gains are rounding.
NO_GAIN = 1e-13

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")


class Family(Protocol):
    """The lenses that one model of a file format can say."""

    @property
    def title(self) -> str:
        """The model's name in the format, and its coefficients."""

    def exactly(self, camera: Camera) -> object | None:
        """Return the camera as the family has it, None if it has not."""

    def start(self, lens: Lens) -> FloatArray:
        """Return parameters to start from."""

    def project(self, parameters: FloatArray, ideal: FloatArray) -> FloatArray:
        """Map ideal normalised points, shape (N, 2), to pixels."""

    def lens(self, parameters: FloatArray, image_size: tuple[int, int]) -> object:
        """Return the lens of these parameters."""

    def monotonic(self, parameters: FloatArray, ideal: FloatArray) -> bool:
        """Whether no distortion folds back where these points are."""


Lens: TypeAlias = "Camera | ForeignLens"


def brown_distorted(
    ideal: FloatArray, radial: Sequence[float], tangential: tuple[float, float]
) -> FloatArray:
    """Map ideal to observed normalised points (N, 2), by any number of radial coefficients."""
    x, y = ideal.T
    square = x * x + y * y
    scale = np.polynomial.polynomial.polyval(square, [1.0, *radial])
    p1, p2 = tangential
    seen_x = x * scale + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    seen_y = y * scale + 2 * p2 * x * y + p1 * (square + 2 * y * y)
    return np.column_stack([seen_x, seen_y])


@dataclass(frozen=True, slots=True)
class BrownFamily:
    """Cameras of `Camera`'s own model with some of its numbers tied.

    Parameters
    ----------
    title : str
        The model's name in the format, and its coefficients.
    free : tuple of str
        The coefficients it has, of ``k1 k2 p1 p2 k3``; the others are zero.
    square : bool
        Whether it has one focal length only.
    """

    title: str
    free: tuple[str, ...]
    square: bool = False

    def exactly(self, camera: Camera) -> Camera | None:
        """Return the camera itself if all that it has is free."""
        values = camera_parameters(camera)
        missing = any(values[name] for name in COEFFICIENTS if name not in self.free)
        return None if missing or (self.square and camera.fx != camera.fy) else camera

    def start(self, lens: Lens) -> FloatArray:
        """Start from K, and from the coefficients that are known."""
        known = camera_parameters(lens) if isinstance(lens, Camera) else {}
        focal = [lens.K[0, 0], lens.K[1, 1]]
        return np.array(
            [
                *([np.mean(focal)] if self.square else focal),
                *lens.K[:2, 2],
                *(known.get(name, 0.0) for name in self.free),
            ]
        )

    def project(self, parameters: FloatArray, ideal: FloatArray) -> FloatArray:
        """Map ideal normalised points to pixels, also beyond a fold."""
        focal, centre, named = self._split(parameters)
        k1, k2, p1, p2, k3 = (named.get(name, 0.0) for name in COEFFICIENTS)
        return np.asarray(brown_distorted(ideal, (k1, k2, k3), (p1, p2)) * focal + centre)

    def lens(self, parameters: FloatArray, image_size: tuple[int, int]) -> Camera:
        """Return the camera."""
        focal, centre, named = self._split(parameters)
        return camera_of(focal.tolist(), centre.tolist(), named, image_size)

    def monotonic(self, parameters: FloatArray, ideal: FloatArray) -> bool:
        """Whether all points lie within the valid radius."""
        named = self._split(parameters)[2]
        radius = _core.invertible_radius(*(named.get(name, 0.0) for name in COEFFICIENTS))
        return bool(np.linalg.norm(ideal, axis=1).max() < radius)

    def _split(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray, dict[str, float]]:
        focals = 1 if self.square else 2
        focal = np.broadcast_to(parameters[:focals], 2)
        centre = parameters[focals : focals + 2]
        named = dict(zip(self.free, parameters[focals + 2 :].tolist(), strict=True))
        return focal, centre, named


ANY_CAMERA = BrownFamily("brown (k1, k2, p1, p2, k3)", COEFFICIENTS)
"""All that a `Camera` can be."""


def nearest(lens: Lens, family: Family) -> Approximation:
    """Fit a family's lens to another one over its picture, by least squares of pixels.

    Both keep the same axis: no rotation is fitted, so that poses stay what they were.

    Raises
    ------
    ValueError
        If less than half the picture has directions ahead of the camera, or the nearest lens
        folds back within it.
    """
    ideal, pixels, covered = _seen(lens)
    parameters = _fitted(family, family.start(lens), ideal, pixels)
    error = np.linalg.norm(family.project(parameters, ideal) - pixels, axis=1)
    if not np.isfinite(error).all() or not family.monotonic(parameters, ideal):
        raise ValueError(
            f"no lens of the model {family.title} comes near: the nearest folds back within the "
            "picture"
        )
    return Approximation(
        family.lens(parameters, lens.image_size),
        family.title,
        float(np.sqrt(np.mean(error**2))),
        float(error.max()),
        covered,
    )


def _seen(lens: Lens) -> tuple[FloatArray, FloatArray, float]:
    """Return ideal normalised points, the pixels of a grid that show them, and how many do."""
    width, height = lens.image_size
    spacing = max(max(width, height) - 1, 1) / (GRID_LINES - 1)
    x, y = (
        np.linspace(0.0, side - 1.0, max(2, round((side - 1) / spacing) + 1))
        for side in (width, height)
    )
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    if isinstance(lens, Camera):
        known = np.array(_core.can_unproject(camera_for_core(lens), pixels), dtype=bool)
        ideal = np.zeros_like(pixels)
        if known.any():
            undistorted = lens.undistort_points(pixels[known])
            ideal[known] = (undistorted - lens.K[:2, 2]) / lens.K.diagonal()[:2]
    else:
        ideal, known = lens.directions(pixels)
    covered = float(known.mean())
    if covered < LEAST_SEEN:
        raise ValueError(
            f"the lens has a direction ahead of the camera for only {100 * covered:.0f} % of "
            "its picture: no other can be fitted to it"
        )
    return ideal[known], pixels[known], covered


def _fitted(
    family: Family, start: FloatArray, ideal: FloatArray, pixels: FloatArray
) -> npt.NDArray[np.float64]:
    """Levenberg and Marquardt's least squares, with differences for derivatives."""
    parameters = start
    residual = (family.project(parameters, ideal) - pixels).ravel()
    cost, damping = residual @ residual, 1e-3
    for _ in range(MOST_STEPS):
        jacobian = _derivatives(family, parameters, ideal)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0] = 1.0
        scaled = jacobian / scale
        normal, gradient = scaled.T @ scaled, scaled.T @ residual
        step = np.linalg.solve(normal + damping * np.eye(len(normal)), gradient) / scale
        tried = parameters - step
        with np.errstate(all="ignore"):
            tried_residual = (family.project(tried, ideal) - pixels).ravel()
            tried_cost = tried_residual @ tried_residual
        if tried_cost < cost:  # false for NaN too
            gain = (cost - tried_cost) / cost
            parameters, residual, cost = tried, tried_residual, tried_cost
            damping = max(damping / 10, 1e-12)
            if gain < NO_GAIN:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10
    return parameters


def _derivatives(family: Family, parameters: FloatArray, ideal: FloatArray) -> FloatArray:
    columns = []
    for index, value in enumerate(parameters):
        shift = np.zeros(len(parameters))
        shift[index] = 1e-5 * max(1.0, abs(value))
        difference = family.project(parameters + shift, ideal) - family.project(
            parameters - shift, ideal
        )
        columns.append(difference.ravel() / (2 * shift[index]))
    return np.column_stack(columns)
