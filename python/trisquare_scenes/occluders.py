"""Overlays on a scene: shapes with the picture's own blur, and soft spots of light or dirt."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Polygons are drawn this many times larger and averaged; the error is a hundredth of a step.
_SUPERSAMPLING = 8
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """Light of a picture after something is laid over it.

    It is ``light (1 - opacity mask) + added_light mask``.

    Parameters
    ----------
    mask : ndarray, shape (H, W)
        Fraction of each pixel that is affected, 0 to 1, blurred like the rest of the picture.
    opacity : float
        Fraction of the light below that is lost where the mask is 1.
    added_light : ndarray, shape (C,) or (H, W, C), or pair of int
        Linear light that is added where the mask is 1, of one or three channels; or the pixel
        (x, y) whose light it takes on, as bare paper does.
    """

    mask: Array
    opacity: float
    added_light: Array | tuple[int, int]

    def __call__(self, canvas: Array) -> Array:
        """Return the canvas, linear light of shape (H, W, C), with this overlay."""
        if isinstance(self.added_light, tuple):
            x, y = self.added_light
            added_light = canvas[y, x]
        else:
            added_light = self.added_light
        mask = self.mask[..., None]
        covered: Array = canvas * (1.0 - self.opacity * mask) + added_light * mask
        return covered


def polygon_mask(polygon: Array, image_size: tuple[int, int], blur: float) -> Array:
    """Return the blurred coverage of every pixel by a polygon.

    Parameters
    ----------
    polygon : ndarray, shape (N, 2)
        Pixels; it may leave the picture.
    image_size : tuple of int
        Width and height, pixels.
    blur : float
        Standard deviation of the optical blur, pixels.

    Returns
    -------
    ndarray, shape (H, W)
    """
    width, height = image_size
    mask = np.zeros((height, width))
    margin = int(np.ceil(6.0 * blur)) + 1
    low = np.clip(np.floor(polygon.min(axis=0)).astype(int) - margin, 0, image_size)
    high = np.clip(np.ceil(polygon.max(axis=0)).astype(int) + margin + 1, 0, image_size)
    if np.any(low >= high):
        return mask
    # The ground continues beyond the picture's border, so that the blur does not fade there.
    size = high - low + 2 * margin
    fine = np.zeros((_SUPERSAMPLING * size[1], _SUPERSAMPLING * size[0]), np.uint8)
    places = (polygon - low + margin + 0.5) * _SUPERSAMPLING - 0.5
    fixed = np.rint(places * 2**_SUBPIXEL_BITS).astype(np.int32)
    cv2.fillPoly(fine, [fixed], 255, shift=_SUBPIXEL_BITS)
    covered = cv2.resize(fine, size.tolist(), interpolation=cv2.INTER_AREA).astype(np.float64)
    blurred = np.asarray(cv2.GaussianBlur(covered / 255.0, (0, 0), blur), dtype=np.float64)
    mask[low[1] : high[1], low[0] : high[0]] = blurred[margin:-margin, margin:-margin]
    return mask


def spot_mask(
    centre: Array, axis: Array, half_widths: tuple[float, float], image_size: tuple[int, int]
) -> Array:
    """Return a soft elliptical spot ``exp(-r^4)``, ``r`` being 1 on the ellipse.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        Pixels.
    axis : ndarray, shape (2,)
        Unit vector along the first half width.
    half_widths : pair of float
        Along the axis and across it, pixels.
    image_size : tuple of int
        Width and height, pixels.

    Returns
    -------
    ndarray, shape (H, W)
    """
    width, height = image_size
    y, x = np.mgrid[0:height, 0:width].astype(np.float64) - centre[::-1, None, None]
    along = (x * axis[0] + y * axis[1]) / half_widths[0]
    across = (y * axis[0] - x * axis[1]) / half_widths[1]
    spot: Array = np.exp(-((along**2 + across**2) ** 2))
    return spot
