"""Drawn outlines of rectangles of a known or an unknown shape, such as sheets of paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare.detection.candidates import Outline, SquareOutline
from trisquare.detection.squares.plain_rectangles import turns_to_longer_side
from trisquare.detection.squares.rectangle_shape import RectangleShape

NO_FRAME = "a frame is a square with a hole, but targets names rectangles"


def taken_as_rectangles(
    snapped: Sequence[SquareOutline | str], image_size: tuple[int, int], shape: RectangleShape
) -> list[SquareOutline | str]:
    """Convert the outlines of one picture to rectangles, whose side 0 is one of the longer two.

    Parameters
    ----------
    snapped : sequence of SquareOutline or str
        Outlines on their edges, or the reasons why they are not.
    image_size : (int, int)
        Width and height.
    shape : RectangleShape

    Returns
    -------
    list of SquareOutline or str
        Rectangles, or the reasons; frames are rejected.
    """
    solid = {
        number: outline.outer
        for number, outline in enumerate(snapped)
        if not isinstance(outline, str) and outline.inner is None
    }
    taken: list[SquareOutline | str] = [
        outline if isinstance(outline, str) else NO_FRAME for outline in snapped
    ]
    if solid:
        corners = np.array([outer.corners for outer in solid.values()])
        turns = turns_to_longer_side(corners, image_size, shape).tolist()
        for (number, outer), turn in zip(solid.items(), turns, strict=True):
            turned = Outline.of(np.array(outer.sides), outer.dark_inside, turn)
            taken[number] = SquareOutline(turned, None, aspect=shape.aspect, is_beside_others=True)
    return taken
