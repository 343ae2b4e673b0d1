"""Photographs in the form in which a page shows them."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from trisquare.images.pixels import Image, picture_size

LARGEST_SHOWN = 1600
"""Maximum length of a shown picture's longer side (px): pages on screens are not wider."""

JPEG_QUALITY = 85
"""JPEG quality; at this size its errors are invisible on a screen."""

SRGB_KNEE = 0.0031308


def shown_pixels(picture: Image, *, linear: bool) -> Image:
    """Return a picture in the form for a screen: 8 bits, no larger than needed.

    Linear light is coded as sRGB; float pictures are assumed to range from 0 to 1.
    """
    width, height = picture_size(picture)
    shrink = LARGEST_SHOWN / max(width, height)
    if shrink < 1.0:
        size = max(round(width * shrink), 1), max(round(height * shrink), 1)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    if picture.dtype == np.uint8 and not linear:
        return picture
    full_scale = np.iinfo(picture.dtype).max if picture.dtype.kind == "u" else 1.0
    light = np.clip(np.nan_to_num(picture.astype(np.float32)) / full_scale, 0.0, 1.0)
    if linear:
        knee = light < SRGB_KNEE
        light = np.where(knee, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    return np.asarray(np.rint(255.0 * light), dtype=np.uint8)


def jpeg_uri(pixels: Image) -> str:
    """Return 8-bit pixels as a data URI of a JPEG."""
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")
