"""View of a plane from straight above, without distortion and perspective."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray, Frozen, not_negative, real_number
from trisquare.analysis.plan import onto_plane
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.images.pixels import LARGEST_RESAMPLED, Image, ImageSource, picture_size
from trisquare.images.reading import load_picture
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

__all__ = ["TopView", "rectify"]

LARGEST = 4096
"""Maximum default length of the longer side, pixels."""

MOST = 16384
"""Maximum length of the longer side, pixels: 0.8 GB in colour."""

BAND = 64
"""Number of rows mapped at a time, to limit the memory of the maps."""

UNSEEN = -2.0
"""Coordinate of a pixel outside every picture."""


@dataclass(frozen=True, slots=True, eq=False)
class TopView(Frozen):
    """A picture of a plane, to scale.

    Attributes
    ----------
    image : ndarray, shape (H, W) or (H, W, 3)
        Same type as the photograph; X of the plane to the right, Y down, black outside the
        photograph.
    origin : (float, float)
        Position of the centre of the top-left pixel on the plane, in units of the side.
    resolution : float
        Pixels per side.

    Examples
    --------
    >>> view = ts.rectify("photo.jpg", result.planes[0], camera, resolution=100)
    >>> x, y = view.origin
    >>> print(f"({x:.1f}, {y:.1f}) at the top left, {view.resolution:.0f} pixels to a side")
    (-1.0, -1.0) at the top left, 100 pixels to a side
    """

    image: Image
    origin: tuple[float, float]
    resolution: float

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        return f"<TopView {width} x {height}: {self.resolution:.6g} px to a side>"


def rectify(
    image: ImageSource,
    plane: Plane,
    camera: Calibration | Camera,
    *,
    margin: float = 0.5,
    resolution: float | None = None,
) -> TopView:
    """Show a plane from straight above.

    Parameters
    ----------
    image : path or ndarray
        The photograph: uint8, uint16 or float32, shape (H, W) or (H, W, 3).
    plane : Plane
        Plane of a calibration, or from `locate`.
    camera : Calibration or Camera
        The camera that took it.
    margin : float
        Margin around the plane's figure, relative to the figure's width and height.
    resolution : float, optional
        Pixels per side of the square; by default the photograph's highest resolution of the figure,
        limited to `LARGEST` pixels for the longer side.

    Returns
    -------
    TopView

    Raises
    ------
    ImageError
        If the picture cannot be read.
    TypeError, ValueError
        For bad arguments; if the size of the picture is not that of the camera; if the view would
        be larger than `MOST` pixels.

    Examples
    --------
    >>> view = ts.rectify("photo.jpg", result.planes[0], camera, resolution=100)
    >>> view.image.shape
    (201, 201)
    """
    if not isinstance(plane, Plane):
        raise TypeError(
            f"plane must be a Plane, such as result.planes[0], not {type(plane).__name__}"
        )
    lens = camera_of(camera)
    picture = load_picture(image)
    size = picture_size(picture)
    if size != lens.image_size:
        raise ValueError(
            f"the picture has {size} pixels, but the camera's pictures have {lens.image_size}"
        )
    if max(size) > LARGEST_RESAMPLED:
        raise ValueError(
            f"pictures of more than {LARGEST_RESAMPLED} pixels a side cannot be resampled"
        )
    figure = onto_plane(plane.corners, lens, plane)
    low, high = figure.min(axis=0), figure.max(axis=0)
    extent = 1.0 + 2.0 * not_negative(margin, "margin")
    longest = extent * float(np.max(high - low))
    if not 0 < longest < math.inf:
        raise ValueError(f"a view of {longest:g} sides cannot be shown")
    margins = margin * (high - low)
    low, high = low - margins, high + margins
    if resolution is None:
        # The photograph's resolution along the best resolved side of the figure.
        sides, pixel_sides = (np.roll(quad, -1, axis=0) - quad for quad in (figure, plane.corners))
        sharpest = np.max(np.linalg.norm(pixel_sides, axis=1) / np.linalg.norm(sides, axis=1))
        scale = min(float(sharpest), (LARGEST - 1) / longest)
    else:
        scale = real_number(resolution, "resolution")
        if not 0 < scale * longest < MOST:
            raise ValueError(
                f"resolution must be positive and at most {(MOST - 1) / longest:.4g} pixels to a "
                f"side, not {scale:g}"
            )
    x, y = (
        start + np.arange(round((end - start) * scale) + 1) / scale
        for start, end in zip(low, high, strict=True)
    )
    bands = [
        _remapped(picture, plane, lens, x, y[start : start + BAND])
        for start in range(0, len(y), BAND)
    ]
    return TopView(np.concatenate(bands), (float(x[0]), float(y[0])), scale)


def _remapped(picture: Image, plane: Plane, camera: Camera, x: FloatArray, y: FloatArray) -> Image:
    """Interpolate the photograph at the points of a grid on the plane."""
    import cv2  # loaded only once there is a picture, as in all of the package

    plane_points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = plane_points @ plane.rotation[:, :2].T + plane.translation
    is_visible = camera.can_project(points)
    pixels = np.full(plane_points.shape, UNSEEN, dtype=np.float32)
    pixels[is_visible] = np.clip(camera.project(points[is_visible]), UNSEEN, max(picture.shape))
    map_x, map_y = (pixels[:, i].reshape(len(y), len(x)) for i in (0, 1))
    return np.asarray(cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR, borderValue=0))
