"""Uncertainty of the projection of a viewing direction, in pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray, RebuiltByConstructor, real_array, real_number
from trisquare._support.suggestions import unknown
from trisquare.camera.camera import Camera, CoreCamera, camera_for_core

# Default number of columns of a map.
DEFAULT_COLUMNS = 32

# Default maximum number of rows of a map, reached if the picture is four times as high as wide.
DEFAULT_ROWS = 128

ROTATIONS = ("fitted", "held")
"""Treatment of a rotation of the camera, to which a shift of the principal point is nearly
equivalent."""

# Maximum number of grid points, more than any picture has pixels.
MAX_PLACES = 10**9


CELLS = 100
"""Number of cells across and down the picture in which fractions of it are counted."""

UncertainCamera: TypeAlias = "tuple[CoreCamera, list[str], bool, FloatArray]"
"""A camera for the core, its free parameters, whether fy depends on fx, and their covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class ProjectionMap(RebuiltByConstructor):
    """Standard deviations of projections over the picture.

    Parameters
    ----------
    x : array_like, shape (C,)
        Columns of the grid, pixels, from the left border to the right one.
    y : array_like, shape (R,)
        Rows of the grid, pixels, from top to bottom.
    std : array_like, shape (R, C)
        Standard deviation of the projection of the direction seen at ``(x[j], y[i])`` (rms,
        pixels); infinite, that is unknown, where the distortion is not invertible.

    Examples
    --------
    >>> uncertainty = result.projection_map(step=100)
    >>> row, column = np.unravel_index(uncertainty.std.argmax(), uncertainty.std.shape)
    >>> print(f"least is known at ({uncertainty.x[column]:.0f}, {uncertainty.y[row]:.0f})")
    least is known at (0, 0)
    """

    x: FloatArray
    y: FloatArray
    std: FloatArray

    def __post_init__(self) -> None:
        x, y = real_array(self.x, "x", (None,)), real_array(self.y, "y", (None,))
        std = np.array(self.std, dtype=np.float64, order="C")
        if std.shape != (len(y), len(x)) or not np.all(std >= 0):
            raise ValueError(f"std must have shape {(len(y), len(x))} and not be negative")
        std.flags.writeable = False
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "std", std)

    def __repr__(self) -> str:
        rows, columns = self.std.shape
        low, high = self.std.min(), self.std.max()
        return f"<ProjectionMap {columns} x {rows}: std {low:.3g} to {high:.3g} px>"


def uncertain(
    camera: Camera,
    parameters: Sequence[str] = (),
    fixed: Sequence[str] = (),
    covariance: FloatArray | None = None,
) -> UncertainCamera:
    """Return a camera with its uncertainty in the core's form; by default it is exact."""
    known = np.zeros((0, 0)) if covariance is None else covariance
    return camera_for_core(camera), list(parameters), "aspect" in fixed, known


def projection_covariance(camera: UncertainCamera, points: npt.ArrayLike) -> FloatArray:
    """Return the covariances of the projections of the directions seen at pixels.

    For the direction ``u`` seen at a pixel, fixed in the camera's frame, it is ``J C J^T`` with
    ``J`` the derivative of the projection with respect to the free parameters and ``C`` their
    covariance.

    Parameters
    ----------
    camera : UncertainCamera
        The camera with its uncertainty.
    points : array_like, shape (N, 2)
        Pixels of the photograph.

    Returns
    -------
    ndarray, shape (N, 2, 2)
        Square pixels.

    Raises
    ------
    ValueError
        If a pixel lies beyond the valid radius.
    """
    return _core.projection_covariance(camera, real_array(points, "points", (None, 2)))


def rms_displacement(covariances: FloatArray) -> FloatArray:
    """Return ``sqrt(trace)`` of covariances of shape (N, 2, 2), shape (N,)."""
    with np.errstate(over="ignore"):  # the next lines check for it
        traces = np.trace(covariances, axis1=1, axis2=2)
    if not np.isfinite(traces).all():
        raise ValueError(
            "the covariance is so large that the covariance of the projections overflows"
        )
    # Rounding may make a zero trace slightly negative.
    return np.asarray(np.sqrt(np.maximum(traces, 0.0)))


def checked_spacing(image_size: tuple[int, int], step: float) -> float:
    """Return the spacing of a grid over a picture if it is valid.

    Raises
    ------
    TypeError, ValueError
        If `step` is not a positive number, or so small that there are too many grid points.
    """
    width, height = image_size
    spacing = real_number(step, "step")
    if spacing <= 0:
        raise ValueError(f"step must be positive, not {spacing}")
    if (width / spacing + 1) * (height / spacing + 1) > MAX_PLACES:
        raise ValueError(f"step {spacing} is too small: the grid would have more than 10^9 points")
    return spacing


def picture_grid(
    image_size: tuple[int, int], step: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return columns and rows of a grid from border to border, at most `step` pixels apart.

    Raises
    ------
    TypeError, ValueError
        As `checked_spacing`.
    """
    width, height = image_size
    if step is None:
        step = max(width / DEFAULT_COLUMNS, height / DEFAULT_ROWS, 1.0)
    spacing = checked_spacing(image_size, step)
    x, y = (np.linspace(0.0, side - 1, math.ceil((side - 1) / spacing) + 1) for side in image_size)
    return x, y


def known_part(camera: Camera) -> float:
    """Return the fraction of the picture, from 0 to 1, within the camera's valid radius."""
    # Points at the centres of cells: a grid from border to border would overweight the borders.
    places = (np.arange(CELLS) + 0.5) / CELLS
    x, y = (side * places - 0.5 for side in camera.image_size)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return float(_has_direction(camera, pixels).mean())


def _has_direction(camera: Camera, pixels: FloatArray) -> npt.NDArray[np.bool_]:
    return np.array(_core.can_unproject(camera_for_core(camera), pixels), dtype=bool)


def projection_map(
    camera: Camera, known: UncertainCamera, step: float | None, rotation: str
) -> ProjectionMap:
    """Return the standard deviations on a grid over the picture, at most `step` pixels apart.

    Raises
    ------
    TypeError, ValueError
        If `step` is not a positive number, or `rotation` is not one of `ROTATIONS`.
    """
    if rotation not in ROTATIONS:
        raise unknown("rotation", rotation, ROTATIONS)
    x, y = picture_grid(camera.image_size, step)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    seen = _has_direction(camera, pixels)
    std = np.full(len(pixels), np.inf)
    if rotation == "held":
        std[seen] = rms_displacement(projection_covariance(known, pixels[seen]))
    elif seen.any():
        # Compared with the estimate taken as exact: only the camera's own uncertainty counts.
        test = _core.compare_projections(known, uncertain(camera), pixels[seen])[2]
        std[seen] = 0.0 if test is None else test[0]
    return ProjectionMap(x, y, std.reshape(len(y), len(x)))
