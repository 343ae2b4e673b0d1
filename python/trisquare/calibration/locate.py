"""Where squares stand that a known camera sees."""

from __future__ import annotations

from trisquare.calibration.calibrate import calibrate
from trisquare.camera.camera import Camera
from trisquare.images.pixels import ImageSource, Outlines, Tone
from trisquare.results.calibration import Calibration
from trisquare.results.camera_of import camera_of
from trisquare.results.plane import Plane

__all__ = ["locate"]


def locate(
    image: ImageSource,
    camera: Calibration | Camera,
    *,
    targets: str = "auto",
    tone: Tone = None,
    outlines: Outlines | None = None,
) -> tuple[Plane, ...]:
    """Find the squares in a photograph, and where they stand before the camera that took it.

    As `calibrate`, with the camera held: one square is enough. The photograph may be one of those
    that the camera was calibrated from, or another of the same camera.

    Parameters
    ----------
    image : path or ndarray
        As in `calibrate`.
    camera : Calibration or Camera
        That took it.
    targets, tone, outlines
        As in `calibrate`; but 8-bit pictures are taken as sRGB and 16-bit ones as linear unless
        `tone` says otherwise: one square tells too little of the curve.

    Returns
    -------
    tuple of Plane
        With poses whose ``uncertainty`` tells what `Plane.measure` needs.

    Raises
    ------
    ImageError, DetectionError, NotEnoughDataError, ConvergenceError
        As `calibrate`.
    TypeError, ValueError
        For bad arguments; if the picture is of another size than the camera's.

    Examples
    --------
    >>> (plane, *others) = ts.locate("photo.jpg", result)
    >>> plane.translation.round(2).tolist()
    [-1.04, -0.57, 2.33]
    """
    held = camera_of(camera)
    found = calibrate(
        image,
        model=held.model,
        fix=("focal", "principal_point", "distortion"),
        initial=held,
        tone=tone,
        targets=targets,
        outlines=outlines,
    )
    return found.planes
