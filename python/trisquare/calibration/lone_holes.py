"""Holes of frames whose outer outlines were not measured; they look like squares."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from trisquare.edges import PlaneEdges

OUTLINED = ("square", "frame")

LONE_HOLE = "shows the hole of a frame whose outer outline was not measured"
"""Description of such a plane in messages."""


def lone_holes(figures: Sequence[PlaneEdges]) -> set[int]:
    """Return the planes of which only the hole of a frame was measured.

    Frames of one calibration have the same colours, dark outside or light outside: if a whole frame
    is present, a single outline with the polarity of its hole is a hole. If no frame is whole, a
    light square may also be a sheet of paper on dark ground.
    """
    outlines_by_plane: defaultdict[int, list[PlaneEdges]] = defaultdict(list)
    for figure in figures:
        if figure.plane is not None and figure.polarity and figure.kind in OUTLINED:
            outlines_by_plane[figure.plane].append(figure)
    whole_frames = [outlines for outlines in outlines_by_plane.values() if len(outlines) == 2]
    hole_polarities = {inner.polarity for _, inner in whole_frames}
    single = {
        plane: outlines[0] for plane, outlines in outlines_by_plane.items() if len(outlines) == 1
    }
    return {plane for plane, outlines in single.items() if outlines.polarity in hole_polarities}
