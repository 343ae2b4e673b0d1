"""The file formats of hand-drawn outlines: trisquare's own and labelme's.

Coordinates are pixels of the picture as it is stored (its orientation tag is ignored), accurate to
5 px. In trisquare's own format a picture has squares. A square is given by its four corners, by a
closed polygon in which the corners are found, or by four polylines, one along each side. The second
outline of a frame is its ``inner``.

.. code-block:: json

   {"format": "trisquare-outlines/1",
    "pictures": [
      {"file": "front.jpg",
       "squares": [
         {"corners": [[101, 80], [310, 92], [295, 301], [88, 276]]},
         {"polygon": [[400, 90], [505, 85], [611, 88], [600, 310], [395, 300]]},
         {"sides": [[[700, 95], [800, 88], [905, 91]], [[905, 91], [890, 300]],
                    [[890, 300], [690, 290]], [[690, 290], [700, 95]]],
          "inner": {"corners": [[740, 130], [860, 128], [850, 260], [735, 255]]}}]},
      {"index": 1,
       "squares": [{"corners": [[50, 50], [150, 50], [150, 150], [50, 150]]}]}]}

For a single picture ``squares`` may stand beside ``format``. The ``width`` and ``height`` of a
picture are checked if they are given.

In labelme's files, polygons, rectangles and linestrips are read. Two closed shapes of one group are
a frame; four linestrips of one group are the sides of a square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.json_members import JsonFields
from trisquare.detection.annotations.outlines import AnnotatedOutline, AnnotatedSquare

OUTLINES_FORMAT = "trisquare-outlines/1"

OPEN_SHAPES = ("linestrip", "line")
"""Labelme's shapes that need not be closed: single ones are outlines, those of a group sides."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedPicture:
    """Outlines drawn on one picture.

    Attributes
    ----------
    targets : tuple of AnnotatedSquare
    name, index : str or int, optional
        The picture's file, without its folders, or its index; neither if there is only one.
    size : (int, int), optional
        Width and height of the picture on which they were drawn, if the file states it.
    where : str
        Place of this picture in the file; empty, or ending with a dot.
    """

    targets: tuple[AnnotatedSquare, ...]
    name: str | None = None
    index: int | None = None
    size: tuple[int, int] | None = None
    where: str = ""

    def joined(self, others: Sequence[AnnotatedPicture]) -> AnnotatedPicture:
        """Add the outlines that the file has elsewhere for the same picture.

        Raises
        ------
        ValueError
            If the picture's stated sizes differ.
        """
        sizes = {picture.size for picture in (self, *others) if picture.size is not None}
        if len(sizes) > 1:
            stated = " and ".join(f"{width} x {height}" for width, height in sorted(sizes))
            name = "one picture" if self.name is None else repr(self.name)
            raise ValueError(f"{name} is drawn on at sizes of {stated} pixels")
        added = [target for picture in others for target in picture.targets]
        return replace(self, targets=(*self.targets, *added), size=next(iter(sizes), None))

    def check_size(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError if it was drawn on a picture of another size."""
        if self.size is None or self.size == image_size:
            return
        turned = self.size == image_size[::-1]
        raise ValueError(
            f"the outlines were drawn on a picture of {self.size[0]} x {self.size[1]} pixels, this "
            f"one has {image_size[0]} x {image_size[1]}"
            + (
                (
                    ": they were drawn on the picture as turned by its orientation tag; draw them "
                    "on the picture as it is stored"
                )
                if turned
                else ""
            )
        )


def annotated_pictures(members: Any) -> list[AnnotatedPicture]:
    """Read parsed JSON of any of the formats.

    Raises
    ------
    ValueError
        If it is none of them, or if a key, which the message names, is missing or wrong.
    """
    fields = JsonFields(members)
    if fields.has("format"):
        pictures = _own(fields)
    elif fields.has("shapes"):
        pictures = [_labelme(fields)]
    else:
        raise ValueError(
            f'is not an outlines file: neither "format" ({OUTLINES_FORMAT}) nor "shapes" '
            "(labelme) is there"
        )
    if not any(picture.targets for picture in pictures):
        raise ValueError("contains no outline")
    return pictures


def _own(fields: JsonFields) -> list[AnnotatedPicture]:
    """Read squares of one picture, or pictures with squares each."""
    fields.check_format(OUTLINES_FORMAT)
    if not fields.has("pictures"):
        return [_own_picture(fields, "")]
    return [
        _own_picture(picture, f"pictures[{i}].")
        for i, picture in enumerate(fields.objects("pictures"))
    ]


def _own_picture(fields: JsonFields, where: str) -> AnnotatedPicture:
    targets = []
    for i, square in enumerate(fields.objects("squares")):
        outer = _own_outline(square, f"{where}squares[{i}]")
        if square.has("inner"):
            inner = _own_outline(square.object("inner"), f"{where}squares[{i}].inner")
            targets.append(AnnotatedSquare.of_two(outer, inner))
        else:
            targets.append(AnnotatedSquare(outer))
    index = fields.integer("index") if fields.has("index") else None
    if index is not None and index < 0:
        raise ValueError(f'"{where}index" must not be negative, but is {index}')
    name = fields.text("file") if fields.has("file") else None
    return AnnotatedPicture(tuple(targets), name, index, _size(fields, "width", "height"), where)


def _own_outline(fields: JsonFields, where: str) -> AnnotatedOutline:
    if fields.has("sides"):
        return AnnotatedOutline.of_sides(fields.arrays("sides", (None, 2)), f'"{where}.sides"')
    key = "polygon" if fields.has("polygon") else "corners"
    points = fields.array(key, (None, 2))
    if key == "corners" and len(points) != 4:
        raise ValueError(f'"{where}.corners" has {len(points)} points: a square has 4 corners')
    return AnnotatedOutline.of_polygon(points, f'"{where}.{key}"')


def _labelme(fields: JsonFields) -> AnnotatedPicture:
    """Read the shapes of one picture.

    A group of two closed shapes is a frame, one of four open shapes a square given by its sides.
    """
    outlines: list[AnnotatedOutline] = []
    groups: list[int | None] = []
    sides: dict[int, list[FloatArray]] = {}
    for i, shape in enumerate(fields.objects("shapes")):
        kind = shape.text("shape_type") if shape.has("shape_type") else "polygon"
        points = shape.array("points", (None, 2))
        group = shape.integer("group_id") if shape.has("group_id") else None
        if kind == "rectangle" and len(points) == 2:
            (left, top), (right, bottom) = points
            points = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        elif kind not in ("polygon", "rectangle", *OPEN_SHAPES):
            raise ValueError(
                f'"shapes[{i}].shape_type" is {kind!r}: draw polygons, rectangles or linestrips'
            )
        if kind in OPEN_SHAPES and group is not None:
            sides.setdefault(group, []).append(points)
        else:
            outlines.append(AnnotatedOutline.of_polygon(points, f'"shapes[{i}].points"'))
            groups.append(group)
    squares = _framed(outlines, groups)
    for group, lines in sides.items():
        where = f'"shapes" of "group_id" {group}'
        squares.append(AnnotatedSquare(AnnotatedOutline.of_sides(lines, where)))
    name = fields.text("imagePath") if fields.has("imagePath") else None
    return AnnotatedPicture(tuple(squares), name, None, _size(fields, "imageWidth", "imageHeight"))


def _framed(
    outlines: Sequence[AnnotatedOutline], groups: Sequence[int | None]
) -> list[AnnotatedSquare]:
    """Make frames of outlines that share a group, squares of the others."""
    squares = []
    frames: dict[int, list[AnnotatedOutline]] = {}
    for outline, group in zip(outlines, groups, strict=True):
        if group is None:
            squares.append(AnnotatedSquare(outline))
        else:
            frames.setdefault(group, []).append(outline)
    for _, members in sorted(frames.items()):
        if len(members) > 2:
            raise ValueError(f"{members[2].where} is the third outline of one frame: it has two")
        squares.append(
            AnnotatedSquare(members[0]) if len(members) == 1 else AnnotatedSquare.of_two(*members)
        )
    return squares


def _size(fields: JsonFields, width: str, height: str) -> tuple[int, int] | None:
    if not (fields.has(width) and fields.has(height)):
        return None
    return fields.integer(width), fields.integer(height)
