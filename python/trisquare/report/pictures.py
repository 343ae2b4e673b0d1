"""The photographs of a report."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trisquare.images.photographs import Photographs
from trisquare.images.pixels import Image, picture_size
from trisquare.results.calibration import Calibration

LARGEST_SHOWN = 1600
"""Pixels of a shown picture's longer side: no screen gives a page's picture more."""

DIGEST_LETTERS = 16
"""Of a file's SHA-256: enough to tell photographs apart."""

SRGB_KNEE = 0.0031308


@dataclass(frozen=True, slots=True, eq=False)
class ReportedPicture:
    """One of the pictures.

    Attributes
    ----------
    index : int
    name : str
        What the report calls it; anything, as it may be a file's name.
    pixels : ndarray of uint8, shape (h, w) or (h, w, 3), or None
        To be shown: at most `LARGEST_SHOWN` wide and high; None if there is no photograph.
    digest : str or None
        Beginning of its file's SHA-256.
    """

    index: int
    name: str
    pixels: Image | None = None
    digest: str | None = None


def reported_pictures(
    calibration: Calibration, photographs: Photographs
) -> Iterator[ReportedPicture]:
    """Yield the calibration's pictures one at a time; there may be no photographs of them.

    Raises
    ------
    ImageError
        If a file cannot be read whole.
    TypeError, ValueError
        For bad arguments, or if a picture is not of the camera's size.
    """
    if not photographs.sources:
        for index in sorted({plane.image for plane in calibration.planes} or {0}):
            yield ReportedPicture(index, f"picture {index}")
    for photograph in photographs:
        index, path = photograph.index, photograph.path
        size, own = picture_size(photograph.pixels), calibration.camera.image_size
        if size != own:
            raise ValueError(
                f"picture {index} is {size[0]} x {size[1]}, the calibration's are {own[0]} x "
                f"{own[1]}: is it one of them?"
            )
        pixels = shown_pixels(photograph.pixels, linear=calibration.tone == "linear")
        if path is None:
            yield ReportedPicture(index, f"picture {index}", pixels)
        else:
            digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()[:DIGEST_LETTERS]
            yield ReportedPicture(index, os.path.basename(path), pixels, digest)


def shown_pixels(picture: Image, *, linear: bool) -> Image:
    """Return a picture as a screen shows it: 8 bits, no larger than needed.

    Linear light is coded as sRGB; float pictures are taken to span 0 to 1.
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
