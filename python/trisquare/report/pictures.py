"""The photographs of a report, with what was measured in them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from trisquare.analysis.residuals import MeasuredSide, measured_sides
from trisquare.detection.annotations.load import Annotations
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.images.pixels import Image, ImageSource, Outlines, picture_size
from trisquare.images.reading import load_picture
from trisquare.measurement.detect import detect
from trisquare.results.calibration import Calibration

LARGEST_SHOWN = 1600
"""Pixels of a shown picture's longer side: no screen gives a page's picture more."""

DIGEST_LETTERS = 16
"""Of a file's SHA-256: enough to tell photographs apart."""

SRGB_KNEE = 0.0031308


@dataclass(frozen=True, slots=True, eq=False)
class ReportedPicture:
    """One of the pictures.

    Parameters
    ----------
    index : int
    name : str
        What the report calls it; anything, as it may be a file's name.
    pixels : ndarray of uint8, shape (h, w) or (h, w, 3), or None
        To be shown: at most `LARGEST_SHOWN` wide and high; None if there is no photograph.
    sides : tuple of MeasuredSide
        Measured lines with their residuals, in pixels of the photograph itself.
    digest : str or None
        Beginning of its file's SHA-256.
    """

    index: int
    name: str
    pixels: Image | None
    sides: tuple[MeasuredSide, ...]
    digest: str | None = None

    def without_pixels(self) -> ReportedPicture:
        """Return the same but for the pixels, which are most of it."""
        return replace(self, pixels=None)


def reported_pictures(
    calibration: Calibration,
    sources: Sequence[ImageSource],
    edges: Sequence[PlaneEdges] | None,
    targets: str,
    outlines: Outlines | None,
) -> Iterator[ReportedPicture]:
    """Load the pictures one at a time and measure what the calibration measured.

    Parameters
    ----------
    calibration : Calibration
    sources : sequence of path or ndarray
        The calibration's pictures in their order; it may be empty.
    edges : sequence of PlaneEdges, optional
        What was measured, instead of measuring it again.
    targets, outlines
        As in `calibrate`.

    Raises
    ------
    ImageError
        If a file cannot be read whole.
    TypeError, ValueError
        For bad arguments, or if a picture is not of the camera's size.
    """
    if not sources:
        for index in sorted({plane.image for plane in calibration.planes} or {0}):
            sides = _sides(calibration, edges or (), index)
            yield ReportedPicture(index, f"picture {index}", None, sides)
        return
    drawings = None if outlines is None else Annotations.read(outlines, sources)
    for index, source in enumerate(sources):
        picture = load_picture(source)
        size = picture_size(picture)
        if size != calibration.camera.image_size:
            width, height = calibration.camera.image_size
            raise ValueError(
                f"picture {index} is {size[0]} x {size[1]}, the calibration's are {width} x "
                f"{height}: is it one of them?"
            )
        of_picture = edges
        if edges is None:
            of_picture = _measured(calibration, picture, index, targets, drawings)
        path = source if isinstance(source, str | os.PathLike) else None
        yield ReportedPicture(
            index,
            f"picture {index}" if path is None else os.path.basename(path),
            shown_pixels(picture, linear=calibration.tone == "linear"),
            _sides(calibration, of_picture or (), index),
            None if path is None else _digest(path),
        )


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


def _measured(
    calibration: Calibration,
    picture: Image,
    index: int,
    targets: str,
    drawings: Annotations | None,
) -> list[PlaneEdges]:
    # In a picture that gave no plane (nothing in it, or given twice) nothing was measured.
    if not any(plane.image == index for plane in calibration.planes):
        return []
    drawn = None if drawings is None else drawings.on(index, picture_size(picture))
    try:
        found = detect(picture, targets=targets, tone=calibration.tone, outlines=drawn)
    except DetectionError:
        return []  # another picture than the calibration's, or other targets
    return [replace(figure, image=index) for figure in found]


def _sides(
    calibration: Calibration, edges: Sequence[PlaneEdges], index: int
) -> tuple[MeasuredSide, ...]:
    try:
        return tuple(measured_sides(calibration, edges, index))
    except ValueError:
        return ()  # samples where the camera does not reach are not this calibration's


def _digest(path: str | os.PathLike[str]) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:DIGEST_LETTERS]
