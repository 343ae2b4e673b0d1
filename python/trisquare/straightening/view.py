"""Pinhole views of pictures, from a camera whose focal length is not known."""

from __future__ import annotations

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray, real_number
from trisquare.images.pixels import LARGEST_RESAMPLED, Image, ImageSource, picture_size
from trisquare.images.reading import load_picture
from trisquare.straightening.camera import UnscaledCamera
from trisquare.undistortion.undistort import INTERPOLATIONS, Interpolation, checked_interpolation

TABLE_ENTRIES = 4096
"""Number of entries of the table of observed radii; interpolation between them is accurate to
1e-4 px."""

STRIP_ROWS = 512


def undistort_picture(
    image: ImageSource,
    camera: UnscaledCamera,
    balance: float = 0.0,
    interpolation: Interpolation = "linear",
) -> Image:
    """Return a picture of the camera without its distortion, of the same size.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, or the picture of another size than the camera's.
    """
    interpolation = checked_interpolation(interpolation)
    picture = np.ascontiguousarray(load_picture(image))
    width, height = picture_size(picture)
    if (width, height) != camera.image_size:
        size = "{} x {}".format(*camera.image_size)
        raise ValueError(
            f"the picture has {width} x {height} pixels, but the camera's pictures have {size}"
        )
    if max(width, height) > LARGEST_RESAMPLED:
        raise ValueError(f"pictures of more than {LARGEST_RESAMPLED} pixels a side")
    zoom = view_zoom(camera, balance)
    middle = 0.5 * (np.array([width, height]) - 1)
    method, border = (getattr(cv2, name) for name in INTERPOLATIONS[interpolation])
    straight = np.empty_like(picture)
    radii, ratios = _table(camera, float(np.hypot(width, height)) / camera.radius / zoom)
    for top in range(0, height, STRIP_ROWS):
        rows = np.arange(top, min(top + STRIP_ROWS, height))
        # The view's middle is the picture's; its scale is about the centre of distortion.
        x, y = np.meshgrid((np.arange(width) - middle[0]) / zoom, (rows - middle[1]) / zoom)
        offsets = (x + middle[0] - camera.centre[0], y + middle[1] - camera.centre[1])
        ideal = np.hypot(*offsets) / camera.radius
        ratio = np.interp(ideal, radii, ratios, right=0.0)
        source = [
            offset * ratio + start for offset, start in zip(offsets, camera.centre, strict=True)
        ]
        is_outside = (source[0] < -0.5) | (source[0] > width - 0.5) | (ratio == 0)
        is_outside |= (source[1] < -0.5) | (source[1] > height - 0.5)
        strip = cv2.remap(
            picture,
            source[0].astype(np.float32),
            source[1].astype(np.float32),
            method,
            borderMode=border,
        )
        strip[is_outside] = 0
        straight[rows] = strip
    return straight


def view_zoom(camera: UnscaledCamera, balance: float) -> float:
    """Return the magnification of the view at the centre.

    At a balance of 0 nothing but the photograph is seen, at 1 all of it within the valid radius.
    """
    fraction = real_number(balance, "balance")
    if not 0 <= fraction <= 1:
        raise ValueError(f"balance must be from 0 to 1, not {balance}")
    width, height = camera.image_size
    middle = 0.5 * (np.array([width, height]) - 1)
    x, y = np.linspace(0, width - 1, 201), np.linspace(0, height - 1, 201)
    left = np.column_stack([np.zeros_like(y), y])
    top = np.column_stack([x, np.zeros_like(x)])
    right, bottom = left + np.array([width - 1, 0]), top + np.array([0, height - 1])
    sides = [(left, 0), (right, 0), (top, 1), (bottom, 1)]
    distances = [np.abs(_clipped(camera, side) - middle)[:, axis] for side, axis in sides]
    halves = [max(middle[axis], 0.5) for _, axis in sides]
    inner = max(half / max(r.min(), 1e-9) for half, r in zip(halves, distances, strict=True))
    outer = min(half / max(r.max(), 1e-9) for half, r in zip(halves, distances, strict=True))
    return float(inner + fraction * (outer - inner))


def _clipped(camera: UnscaledCamera, points: FloatArray) -> FloatArray:
    """Return ideal positions of points; those beyond the valid radius are moved to its end."""
    offsets = points - camera.centre
    distance = np.maximum(np.linalg.norm(offsets, axis=1), 1e-9)
    largest = camera.radial.largest_radius() * camera.radius
    inside = camera.centre + offsets * np.minimum(1.0, 0.999 * largest / distance)[:, None]
    return camera.undistort_points(inside)


def _table(camera: UnscaledCamera, farthest: float) -> tuple[FloatArray, FloatArray]:
    """Return ideal radii in half diagonals, and the ratios of the observed ones to them."""
    largest = min(1.01 * farthest + 0.1, camera.largest_ideal_radius())
    radii = np.linspace(0.0, largest, TABLE_ENTRIES)
    ratios = np.ones(TABLE_ENTRIES)
    ratios[1:] = camera.radial.observed_radius(radii[1:]) / radii[1:]
    return radii, ratios
