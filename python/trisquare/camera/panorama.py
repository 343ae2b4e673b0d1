"""Views too wide for a pinhole: on a cylinder, or on a sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import (
    ComparedByValue,
    FloatArray,
    RebuiltByConstructor,
    real_array,
    real_number,
    size_of_image,
)
from trisquare._support.suggestions import unknown
from trisquare.camera.camera import Camera, camera_for_core, field_of_view
from trisquare.camera.camera_of import HasCamera, camera_of

# Highest latitude that each projection shows: on a cylinder, latitudes appear as their tangents.
HIGHEST_LATITUDES = {"cylinder": math.radians(60.0), "equirectangular": math.pi / 2}

# Number of pixels tested along the row and the column through the axis, to find the view's ends.
STEPS = 4096


@dataclass(frozen=True, slots=True, eq=False)
class Panorama(RebuiltByConstructor, ComparedByValue):
    """A picture on a cylinder or a sphere about the camera's centre, without distortion.

    The pixel ``(cx, cy)`` shows the camera's axis. With the longitude ``atan2(X, Z)`` and the
    latitude ``atan2(Y, hypot(X, Z))`` of a direction, its pixel is ``cx + focal * longitude``, and
    ``cy + focal * latitude`` ("equirectangular") or ``cy + focal * tan(latitude)`` ("cylinder").

    Parameters
    ----------
    projection : {"equirectangular", "cylinder"}
        On a cylinder, lines of the scene along the picture's Y axis remain straight.
    focal : float
        Pixels per radian at ``(cx, cy)``.
    cx, cy : float
        The pixel of the camera's axis.
    image_size : (int, int)
        Width and height in pixels.

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type, is not finite, or there is no such projection.

    Examples
    --------
    >>> panorama = ts.Panorama("cylinder", 900.0, 639.5, 479.5, (1280, 960))
    >>> panorama.project([[0, 0, 1]]).tolist()
    [[639.5, 479.5]]
    """

    projection: str
    focal: float
    cx: float
    cy: float
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        _check_projection(self.projection)
        for name in ("focal", "cx", "cy"):
            object.__setattr__(self, name, real_number(getattr(self, name), name))
        if self.focal <= 0:
            raise ValueError(f"focal must be positive, not {self.focal:g}")
        object.__setattr__(self, "image_size", size_of_image(self.image_size))

    @classmethod
    def of(
        cls,
        camera: HasCamera | Camera,
        projection: str = "equirectangular",
        field: float | None = None,
    ) -> Panorama:
        """Return a panorama of a camera's pictures, with their scale at the axis.

        Parameters
        ----------
        camera : Calibration or Camera
            The camera of the pictures.
        projection : {"equirectangular", "cylinder"}
            As in `Panorama`.
        field : float, optional
            Width of the panorama, degrees, half of it on each side of the axis; by default the
            width of the photograph's row through the principal point. The height is that of the
            photograph's column through the principal point; on a cylinder, at most 60 degrees on
            each side.

        Raises
        ------
        TypeError, ValueError
            If `camera` is not a camera, `field` is not above 0 and at most 360, there is no such
            projection, or the camera cannot undistort the pixels about its principal point.

        Examples
        --------
        >>> panorama = ts.Panorama.of(camera, "cylinder", field=60)
        >>> laid_out = ts.undistort("photo.jpg", camera, new_camera=panorama)
        >>> laid_out.shape == panorama.image_size[::-1]
        True
        """
        camera = camera_of(camera)
        _check_projection(projection)
        longitudes, latitudes = _ends_seen(camera, axis=0), _ends_seen(camera, axis=1)
        if field is not None:
            half = math.radians(field_of_view(field, 360.0)) / 2
            longitudes = np.array([-half, half])
        highest = HIGHEST_LATITUDES[projection]
        latitudes = latitudes.clip(-highest, highest)
        if projection == "cylinder":
            latitudes = np.tan(latitudes)
        (left, right), (top, bottom) = camera.fx * longitudes, camera.fx * latitudes
        size = (math.floor(right - left) + 1, math.floor(bottom - top) + 1)
        return cls(projection, camera.fx, -left, -top, size)

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Return the pixels that show points of the camera's frame.

        Parameters
        ----------
        points : array_like, shape (N, 3)
            ``(X, Y, Z)`` in any unit.

        Returns
        -------
        ndarray, shape (N, 2)
            Pixels; they may lie outside the picture. NaN for points on the axis of a cylinder,
            which it does not show.

        Examples
        --------
        >>> panorama = ts.Panorama("equirectangular", 900.0, 639.5, 479.5, (1280, 960))
        >>> panorama.project([[0, 0, 1], [1, 0, 1]]).round(1).tolist()
        [[639.5, 479.5], [1346.4, 479.5]]
        """
        return _core.view_pixels(view_for_core(self), real_array(points, "points", (None, 3)))

    def unproject(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return the unit rays, in the camera's frame, of pixels.

        Parameters
        ----------
        pixels : array_like, shape (N, 2)
            Pixels of this picture.

        Returns
        -------
        ndarray, shape (N, 3)

        Examples
        --------
        >>> panorama = ts.Panorama("equirectangular", 900.0, 639.5, 479.5, (1280, 960))
        >>> panorama.unproject([[639.5, 479.5]]).tolist()
        [[0.0, 0.0, 1.0]]
        """
        directions = _core.view_directions(
            view_for_core(self), real_array(pixels, "pixels", (None, 2))
        )
        rays: FloatArray = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return rays

    def __repr__(self) -> str:
        width, height = self.image_size
        return (
            f"<Panorama {width} x {height}, {self.projection}: focal {self.focal:.6g}, "
            f"cx {self.cx:.6g}, cy {self.cy:.6g}>"
        )


def view_for_core(view: Camera | Panorama) -> tuple[str, float, float, float, float]:
    """Return an undistorted picture's view in the form that the compiled core accepts."""
    if isinstance(view, Panorama):
        return view.projection, view.focal, view.focal, view.cx, view.cy
    return "pinhole", view.fx, view.fy, view.cx, view.cy


def _check_projection(projection: Any) -> None:
    if projection not in HIGHEST_LATITUDES:
        raise unknown("projection", str(projection), HIGHEST_LATITUDES)


def _ends_seen(camera: Camera, axis: int) -> FloatArray:
    """Return the range of angles (2,) from the axis of a row or a column, in radians."""
    pixels = np.tile(camera.K[:2, 2], (STEPS, 1))
    pixels[:, axis] = np.linspace(0.0, camera.image_size[axis] - 1.0, STEPS)
    seen = np.array(_core.can_unproject(camera_for_core(camera), pixels), dtype=bool)
    if seen.sum() < 2:
        raise ValueError("the camera cannot undistort the pixels about its principal point")
    rays = camera.unproject(pixels[seen])
    angles = np.arctan2(rays[:, axis], rays[:, 2])
    return np.array([angles.min(), angles.max()])
