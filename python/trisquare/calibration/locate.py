"""Poses of squares before a known camera."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import NORMAL_MEDIAN, FloatArray
from trisquare._support.log import LOG
from trisquare.calibration.calibrate import calibrate
from trisquare.calibration.lone_holes import LONE_HOLE, lone_holes
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.images.pixels import ImageSource, Outlines, Tone
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

__all__ = ["locate"]

MAX_MISFIT_RATIO = 4.0
"""Ratio of residuals to their noise, relative to that at calibration, above which a warning is
given.

The ratio is up to 1.5 for paper that is not flat, compared with another sheet of it at calibration.
For a picture that was undistorted it is 3 in the corners of a weak lens, and 100 for a strong one.
"""

MIN_MISFIT_RMS = 0.3
"""Residuals (px) below which no warning is given: a tone curve other than sRGB displaces edges by
0.1 px."""


HOLE = f"{LONE_HOLE}: its side is that of the hole, not of the frame"


class Located(NamedTuple):
    """Planes that a known camera sees, a doubt about each, and indices of lone holes of frames."""

    planes: tuple[Plane, ...]
    doubts: tuple[str | None, ...]
    holes: Collection[int]


def locate(
    image: ImageSource,
    camera: Calibration | Camera,
    *,
    targets: str = "auto",
    tone: Tone = None,
    outlines: Outlines | None = None,
    side: str | float | None = None,
) -> tuple[Plane, ...]:
    """Find the squares in a photograph, and their poses before the camera that took it.

    As `calibrate`, with a fixed camera: one square is enough. The photograph may be one of those
    that the camera was calibrated from, or another of the same camera. The logger ``trisquare``
    warns of squares that are not consistent with this camera, as in a picture that was undistorted,
    and of holes of frames whose outer outlines are hidden: a frame's side is not that of its hole.

    Parameters
    ----------
    image : path or ndarray
        As in `calibrate`.
    camera : Calibration or Camera
        The camera that took it.
    targets, tone, outlines
        As in `calibrate`; but 8-bit pictures are taken as sRGB and 16-bit ones as linear unless
        `tone` is given: one square does not determine the curve.
    side : str or float, optional
        As in `calibrate`: with it, lengths are metric. It is not taken from a calibration, whose
        targets may be others.

    Returns
    -------
    tuple of Plane
        Planes whose poses have the ``uncertainty`` that `measure` needs.

    Raises
    ------
    ImageError, DetectionError, NotEnoughDataError, ConvergenceError
        As `calibrate`.
    TypeError, ValueError
        For bad arguments; if the size of the picture is not that of the camera.

    Examples
    --------
    >>> (plane, *others) = ts.locate("photo.jpg", result)
    >>> plane.translation.round(2).tolist()
    [-1.04, -0.57, 2.33]
    """
    located_planes = located(
        image, camera, targets=targets, tone=tone, outlines=outlines, side=side
    )
    for index, doubt in enumerate(located_planes.doubts):
        if doubt is not None:
            LOG.warning("plane %d: %s [plane_misfits]", index, doubt)
        if index in located_planes.holes:
            LOG.warning("plane %d %s [side_unknown]", index, HOLE)
    return located_planes.planes


def located(
    image: ImageSource,
    camera: Calibration | Camera,
    *,
    targets: str = "auto",
    tone: Tone = None,
    outlines: Outlines | None = None,
    side: str | float | None = None,
) -> Located:
    """Find what `locate` finds, and which squares the camera does not explain."""
    known = camera_of(camera)
    calibration = calibrate(
        image,
        model=known.model,
        fix=("focal", "principal_point", "distortion"),
        initial=known,
        tone=tone,
        targets=targets,
        outlines=outlines,
        side=side,
    )
    expected = max(1.0, camera.noise_scale) if isinstance(camera, Calibration) else 1.0
    doubts = (
        _doubt(plane, misfit)
        if misfit > MAX_MISFIT_RATIO * expected and plane.rms > MIN_MISFIT_RMS
        else None
        for plane, misfit in zip(calibration.planes, _misfits(calibration), strict=True)
    )
    return Located(calibration.planes, tuple(doubts), lone_holes(calibration.edges))


def _misfits(calibration: Calibration) -> Iterator[float]:
    """Yield the ratio of each plane's residuals to their noise, by medians."""
    scaled_residuals: list[list[FloatArray]] = [[] for _ in calibration.planes]
    for edges, residuals in zip(calibration.edges, calibration.residuals, strict=True):
        assert edges.std is not None  # measured edges have standard deviations
        sides = zip(residuals.distances, edges.std, strict=True)
        scaled_residuals[residuals.plane] += [distances / std for distances, std in sides]
    for plane_residuals in scaled_residuals:
        yield float(np.median(np.abs(np.concatenate(plane_residuals)))) / NORMAL_MEDIAN


def _doubt(plane: Plane, misfit: float) -> str:
    return (
        f"the edges of the {plane.kind} lie {plane.rms:.2g} px (rms) from where this camera would "
        f"show them, {misfit:.0f} times their noise: is the picture as this camera took it (not "
        f"undistorted, not cropped, the same zoom), and is the {plane.kind} flat and of the right "
        "shape?"
    )
