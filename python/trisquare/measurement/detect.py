"""Finding targets in a picture and measuring them."""

from __future__ import annotations

from trisquare.detection.kinds import TargetKinds, nothing_found
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.images.pixels import (
    ImageSource,
    Outlines,
    Tone,
    as_recorded,
    checked_tone,
    picture_size,
    tone_of,
)
from trisquare.images.reading import load_picture


def detect(
    image: ImageSource,
    targets: str = "auto",
    tone: Tone = None,
    *,
    outlines: Outlines | None = None,
) -> list[PlaneEdges]:
    """Find planar targets and measure their edges.

    All targets found are returned; `calibrate` selects those that one camera explains.

    Parameters
    ----------
    image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
        Grey or BGR.
    targets : str
        - ``"squares"``: dark squares on a lighter ground or the reverse, solid or framed;
        - ``"tags"``, ``"aruco"``, ``"apriltag"``: the black borders of tags of any dictionary, each
          a square of its own; ``"tags:6X6_250"``: of that dictionary, known to be present;
        - ``"auto"``: these, and chessboards and Kalibr's AprilGrids of any size, each one plane;
        - ``"a4"``, ``"letter"``, ``"card"``, ``"16:9"``, ``"rectangle:1.5"``: rectangles of that
          aspect, either way up, on any ground and with anything inside; ``"rectangle"``: of any
          aspect, which is estimated, and for which part of the camera has to be held;
        - ``"chessboard:9x6"``: one board of 9 x 6 inner corners;
        - ``"charuco:10x10:0.75"``: ChArUco boards of 10 x 10 squares (across and down) with markers
          of 0.75 of a square, each one plane; board f carries the numbers from f M to f M + M - 1,
          M being the number of its markers;
        - ``"aruco:5x7:0.2"`` or ``"apriltag:6x6:0.3"``: likewise sheets of 5 x 7 markers with gaps
          of 0.2 of a marker's side, numbered row by row from the top, or the bottom as Kalibr does;
        - ``"aprilgrid:6x6:0.3"``: likewise AprilGrids, whose tags have borders of two cells;
          the dark squares between their corners are measured, too;
        - each of these with a dictionary, as ``"charuco:10x10:0.75:6X6_1000"``, is faster;
        - ``"layout.json"``: sheets of markers whose corners the file has by their numbers,
          ``{"dictionary": "6X6_250", "sheets": [{"markers": {"7": [[0, 0], [1, 0], [1, 1], [0, 1]],
          ...}}, ...]}``, x to the right and y down, clockwise from the top left of the code.
    tone : {"auto", "srgb", "linear"} or float, optional
        How light was coded into pixel values; a number is a gamma, and "auto" estimates the curve
        from the edges' profiles. By default "auto" for 8 and 16 bits and linear for floats.
    outlines : path, mapping or sequence, optional
        Coarse outlines of the squares, or of the rectangles that `targets` names, drawn by hand,
        instead of a search. They may be 5 px off: the edges are measured in the picture. A JSON
        file (trisquare's own format or labelme's), its parsed content, or a sequence of outlines,
        each an array_like of shape (N, 2), four corners or a closed polygon, or four polylines.

    Returns
    -------
    list of PlaneEdges
        Samples in pixels with a standard deviation each; `kind` is ``"square"``, ``"frame"``,
        ``"tag"``, ``"rectangle"``, ``"chessboard"``, ``"charuco"`` or ``"sheet"``. Figures on
        one sheet share their `plane`: the two outlines of a frame, a ChArUco board's chessboard and
        its markers.

    Raises
    ------
    ImageError
        If a file cannot be read completely.
    DetectionError
        If no target is found, or no outline lies on the edges of a square.
    TypeError, ValueError
        For bad arguments.

    Examples
    --------
    >>> for figure in ts.detect("photo.jpg", targets="squares")[:2]:
    ...     print(figure.kind, figure.plane, sum(len(points) for points in figure.points))
    frame 0 338
    frame 0 204
    """
    from trisquare.measurement.measure import measure

    kinds = TargetKinds.parse(targets)
    checked = checked_tone(tone)
    picture = as_recorded(load_picture(image))
    annotated = None
    if outlines is not None:
        from trisquare.detection.annotations.load import Annotations

        annotated = Annotations.read(outlines, [image]).on(0, picture_size(picture))
    measured = measure(picture, kinds, tone_of(picture, checked), annotated)
    if not measured.figures:
        reasons = [candidate.reason for candidate in measured.rejected]
        nothing = nothing_found(
            kinds,
            picture_size(picture),
            measured.rejected,
            lack=measured.search.lack_of_contrast(),
        )
        raise DetectionError("; ".join(reasons) if annotated else nothing)
    return measured.figures
