"""The formats that outlines drawn by hand come in: trisquare's own, labelme's and COCO's.

Coordinates are pixels of the picture as it is stored, whatever its orientation tag says, and good
to 5 px. In trisquare's own format a picture has squares, each by its four corners, by a closed
polygon in which they are found, or by four polylines, one along each side; a second outline of a
frame is its ``inner``. A chessboard is given by rows of its crossings, null where there is none.

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
       "chessboards": [{"crossings": [[[50, 50], [100, 50], [150, 50]],
                                      [[50, 100], null, [150, 100]],
                                      [[50, 150], [100, 150], [150, 150]],
                                      [[50, 200], [100, 200], [150, 200]]]}]}]}

For a single picture ``squares`` and ``chessboards`` may stand beside ``format``. ``width`` and
``height`` of a picture are checked if they are there.

Of labelme's files polygons, rectangles and linestrips are read; two closed shapes of one group are
a frame, and four linestrips of one group a square's sides. Of COCO's, the polygons of annotations;
two polygons of one annotation are a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from trisquare._support.arrays import FloatArray, real_array
from trisquare._support.json_members import JsonFields
from trisquare.detection.annotations.grid import DrawnGrid
from trisquare.detection.annotations.outlines import AnnotatedOutline, AnnotatedSquare
from trisquare.edges import MAX_COORDINATE

AnnotatedTarget: TypeAlias = AnnotatedSquare | DrawnGrid

OUTLINES_FORMAT = "trisquare-outlines/1"

OPEN_SHAPES = ("linestrip", "line")
"""Labelme's shapes that need not be closed: alone they are outlines all the same, in a group sides.
"""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedPicture:
    """What is drawn on one picture.

    Attributes
    ----------
    targets : tuple of AnnotatedSquare or DrawnGrid
    name, index : str or int, optional
        Which picture it is: its file, folders not counting, or its place; neither if there is
        only one.
    size : (int, int), optional
        Width and height of the picture that was drawn on, where the file states it.
    where : str
        Where in the file this picture is; empty, or ending with a dot.
    """

    targets: tuple[AnnotatedTarget, ...]
    name: str | None = None
    index: int | None = None
    size: tuple[int, int] | None = None
    where: str = ""

    def joined(self, other: AnnotatedPicture) -> AnnotatedPicture:
        """Add what is drawn elsewhere in the file on the same picture."""
        return replace(self, targets=self.targets + other.targets)

    def check_size(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError if it was drawn on a picture of another size."""
        if self.size is None or self.size == image_size:
            return
        turned = self.size == image_size[::-1]
        raise ValueError(
            f"the outlines were drawn on a picture of {self.size[0]} x {self.size[1]} pixels, this "
            f"one has {image_size[0]} x {image_size[1]}"
            + (
                ": they belong to the picture turned upright by its orientation tag, and must be "
                "drawn on the picture as it is stored"
                if turned
                else ""
            )
        )


def annotated_pictures(members: Any) -> list[AnnotatedPicture]:
    """Read parsed JSON of any of the formats.

    Raises
    ------
    ValueError
        If it is none of them; or naming the key that is missing or wrong.
    """
    fields = JsonFields(members)
    formats: tuple[tuple[str, Callable[[JsonFields], list[AnnotatedPicture]]], ...] = (
        ("format", _own),
        ("shapes", _labelme),
        ("annotations", _coco),
    )
    for key, read in formats:
        if fields.has(key):
            pictures = read(fields)
            if not any(picture.targets for picture in pictures):
                raise ValueError("holds no outline")
            return pictures
    raise ValueError(
        f'has none of the keys of outlines: "format" ({OUTLINES_FORMAT}), "shapes" (labelme) or '
        '"annotations" (COCO)'
    )


def _own(fields: JsonFields) -> list[AnnotatedPicture]:
    """Read squares of one picture, or pictures with squares each."""
    if fields.text("format") != OUTLINES_FORMAT:
        raise ValueError(f'"format" must be {OUTLINES_FORMAT!r}, not {fields.text("format")!r}')
    if not fields.has("pictures"):
        return [_own_picture(fields, "")]
    return [
        _own_picture(picture, f"pictures[{i}].")
        for i, picture in enumerate(fields.objects("pictures"))
    ]


def _own_picture(fields: JsonFields, where: str) -> AnnotatedPicture:
    targets: list[AnnotatedTarget] = []
    boards = fields.objects("chessboards") if fields.has("chessboards") else ()
    squares = fields.objects("squares") if fields.has("squares") or not boards else ()
    for i, square in enumerate(squares):
        outer = _own_outline(square, f"{where}squares[{i}]")
        if square.has("inner"):
            inner = _own_outline(square.object("inner"), f"{where}squares[{i}].inner")
            targets.append(AnnotatedSquare.of_two(outer, inner))
        else:
            targets.append(AnnotatedSquare(outer))
    for i, board in enumerate(boards):
        targets.append(_own_grid(board, f"{where}chessboards[{i}]"))
    index = fields.integer("index") if fields.has("index") else None
    if index is not None and index < 0:
        raise ValueError(f'"{where}index" must not be negative, but is {index}')
    name = fields.text("file") if fields.has("file") else None
    return AnnotatedPicture(tuple(targets), name, index, _size(fields, "width", "height"), where)


def _own_grid(fields: JsonFields, where: str) -> DrawnGrid:
    """Read rows of crossings, null where there is none."""
    where = f'"{where}.crossings"'
    rows = fields.value("crossings")
    if not isinstance(rows, list) or not all(isinstance(row, list) and row for row in rows):
        raise ValueError(f"{where} must be a list of rows, each a list of points or null")
    present = [[point is not None for point in row] for row in rows]
    points = [[[0, 0] if point is None else point for point in row] for row in rows]
    try:
        crossings = real_array(points, where, (None, None, 2))
    except TypeError as error:
        raise ValueError(str(error)) from error
    if not (np.abs(crossings) <= MAX_COORDINATE).all():
        raise ValueError(f"{where} holds coordinates beyond {MAX_COORDINATE:g} px")
    return DrawnGrid(crossings, np.array(present), where)


def _own_outline(fields: JsonFields, where: str) -> AnnotatedOutline:
    if fields.has("sides"):
        return AnnotatedOutline.of_sides(fields.arrays("sides", (None, 2)), f'"{where}.sides"')
    key = "polygon" if fields.has("polygon") else "corners"
    points = fields.array(key, (None, 2))
    if key == "corners" and len(points) != 4:
        raise ValueError(f'"{where}.corners" has {len(points)} points: a square has 4 corners')
    return AnnotatedOutline.of_polygon(points, f'"{where}.{key}"')


def _labelme(fields: JsonFields) -> list[AnnotatedPicture]:
    """Read the shapes of one picture.

    A group of two closed shapes is a frame, one of four open ones a square by its sides.
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
    return [
        AnnotatedPicture(tuple(squares), name, None, _size(fields, "imageWidth", "imageHeight"))
    ]


def _coco(fields: JsonFields) -> list[AnnotatedPicture]:
    """Read the polygons of several pictures; two polygons of one annotation are a frame."""
    squares: dict[int, list[AnnotatedSquare]] = {}
    for i, annotation in enumerate(fields.objects("annotations")):
        where = f"annotations[{i}].segmentation"
        if isinstance(annotation.value("segmentation"), dict):
            raise ValueError(f'"{where}" is a mask (RLE): polygons are needed')
        outlines = []
        for k, flat in enumerate(annotation.arrays("segmentation", (None,))):
            if len(flat) % 2:
                raise ValueError(f'"{where}[{k}]" must hold x and y in turn')
            outlines.append(AnnotatedOutline.of_polygon(flat.reshape(-1, 2), f'"{where}[{k}]"'))
        if not outlines:
            raise ValueError(f'"{where}" holds no polygon')
        found = _framed(outlines, [0] * len(outlines))
        squares.setdefault(annotation.integer("image_id"), []).extend(found)
    pictures = []
    for i, image in enumerate(fields.objects("images")):
        drawn = tuple(squares.pop(image.integer("id"), ()))
        size = _size(image, "width", "height")
        if drawn:
            pictures.append(
                AnnotatedPicture(drawn, image.text("file_name"), None, size, f"images[{i}].")
            )
    if squares:
        raise ValueError(f'"images" has none with the id {min(squares)} that "annotations" name')
    return pictures


def _framed(
    outlines: Sequence[AnnotatedOutline], groups: Sequence[int | None]
) -> list[AnnotatedSquare]:
    """Make frames of outlines that share a group, squares of the others."""
    squares = [
        AnnotatedSquare(o) for o, group in zip(outlines, groups, strict=True) if group is None
    ]
    for group in sorted({group for group in groups if group is not None}):
        members = [o for o, other in zip(outlines, groups, strict=True) if other == group]
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
