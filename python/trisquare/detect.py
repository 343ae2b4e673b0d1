"""Finding targets in a picture and measuring them."""

from __future__ import annotations

from trisquare import _core
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.pictures import ImageSource, Tone, checked_tone, load_picture, tone_of
from trisquare.targets import Targets, nothing_found


def detect(image: ImageSource, targets: str = "auto", tone: Tone = None) -> list[PlaneEdges]:
    """Find planar targets and measure their edges.

    Parameters
    ----------
    image : path or ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    targets : str
        ``"auto"`` or ``"squares"``: dark squares on a lighter ground or the reverse, solid or
        framed. ``"chessboard:9x6"``: one board of 9 x 6 inner corners.
    tone : {"auto", "srgb", "linear"} or float, optional
        How light was coded into pixel values; a number is a gamma, and "auto" estimates the curve
        from the edges' profiles. By default sRGB for 8-bit pictures and linear for others.

    Returns
    -------
    list of PlaneEdges
        Samples in pixels with a standard deviation each. A frame gives two figures that share
        their `plane`.

    Raises
    ------
    ImageError
        If a file cannot be read whole.
    DetectionError
        If no target is found.
    TypeError, ValueError
        For bad arguments.
    """
    from trisquare.measurement import measure  # OpenCV is loaded where a picture is searched

    wanted = Targets.parse(targets)
    checked = checked_tone(tone)
    picture = load_picture(image)
    found = measure(picture, _core.Picture(picture), wanted, tone_of(picture, checked)).figures
    if not found:
        raise DetectionError(nothing_found(wanted))
    return found
