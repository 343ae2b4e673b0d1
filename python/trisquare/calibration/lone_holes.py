"""Holes of frames whose outer outlines were not measured: squares, but smaller ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from trisquare.edges import PlaneEdges

OUTLINED = ("square", "frame")

LONE_HOLE = "shows the hole of a frame whose outer outline was not measured"
"""What is said of such a plane."""


def lone_holes(figures: Sequence[PlaneEdges]) -> set[int]:
    """Return the planes that show nothing but the hole of a frame.

    Frames of one calibration are printed alike, dark outside or light outside: beside a whole one,
    a single outline of the holes' own polarity is a hole. Where no frame is whole, a light square
    may as well be a sheet of paper on dark ground.
    """
    of_plane: defaultdict[int, list[PlaneEdges]] = defaultdict(list)
    for figure in figures:
        if figure.plane is not None and figure.polarity and figure.kind in OUTLINED:
            of_plane[figure.plane].append(figure)
    whole = [own for own in of_plane.values() if len(own) == 2]
    of_holes = {inner.polarity for _, inner in whole}
    single = {plane: own[0] for plane, own in of_plane.items() if len(own) == 1}
    return {plane for plane, own in single.items() if own.polarity in of_holes}
