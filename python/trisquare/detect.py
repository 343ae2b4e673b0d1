"""Finding targets in a picture and measuring them."""

from __future__ import annotations

from trisquare import _core
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.pictures import (
    ImageSource,
    Outlines,
    Tone,
    checked_tone,
    load_picture,
    picture_size,
    tone_of,
)
from trisquare.targets import Targets, nothing_found


def detect(
    image: ImageSource,
    targets: str = "auto",
    tone: Tone = None,
    *,
    outlines: Outlines | None = None,
) -> list[PlaneEdges]:
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
    outlines : path, mapping or sequence, optional
        Coarse outlines of the squares, drawn by hand, in place of a search. Within 5 px of the
        edges is good enough: the edges are measured, not believed. A JSON file (trisquare's own
        format, labelme's or COCO's polygons), its parsed content, or a sequence of outlines, each
        an array_like of shape (N, 2), four corners or a closed polygon, or four polylines.

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
        If no target is found, or no outline lies on the edges of a square.
    TypeError, ValueError
        For bad arguments.
    """
    from trisquare.measurement import measure  # OpenCV is loaded where a picture is searched

    wanted = Targets.parse(targets)
    checked = checked_tone(tone)
    picture = load_picture(image)
    drawn = None
    if outlines is not None:
        from trisquare.drawings import Drawings

        drawn = Drawings.read(outlines, [image]).on(0, picture_size(picture))
    core = _core.Picture(picture)
    measured = measure(picture, core, wanted, tone_of(picture, checked), drawn)
    if not measured.figures:
        reasons = [candidate.reason for candidate in measured.rejected]
        raise DetectionError("; ".join(reasons) if drawn else nothing_found(wanted))
    return measured.figures
