"""Hand-drawn outlines of each of the pictures, from a file or from lists."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PureWindowsPath
from typing import Any

from trisquare._support.json_members import parse_json
from trisquare._support.number_text import listed
from trisquare._support.paths import naming, read_bytes
from trisquare.detection.annotations.formats import (
    AnnotatedPicture,
    annotated_pictures,
)
from trisquare.detection.annotations.outlines import AnnotatedOutline, AnnotatedSquare
from trisquare.images.pixels import ImageSource, Outlines

MAX_NAMED = 3
"""Maximum number of pictures named in a message."""


@dataclass(frozen=True, slots=True)
class Annotations:
    """Drawn outlines of each picture of a calibration, by its index."""

    of_pictures: tuple[AnnotatedPicture | None, ...]

    @classmethod
    def read(cls, outlines: Outlines, sources: Sequence[ImageSource]) -> Annotations:
        """Read outlines and match them with the pictures they belong to.

        Parameters
        ----------
        outlines : path, mapping, or sequence
            A JSON file, its parsed content, or, for a single picture, a sequence of outlines: each
            an array_like of shape (N, 2), four corners or a closed polygon, or four polylines.
        sources : sequence of path or ndarray
            The pictures.

        Raises
        ------
        TypeError, ValueError
            If a key, which the message names, is wrong; or if nothing is drawn on any of the
            pictures.
        OSError
            If the file cannot be read.
        """
        if isinstance(outlines, str | os.PathLike):
            with naming(outlines):
                return cls._matched(annotated_pictures(parse_json(read_bytes(outlines))), sources)
        if isinstance(outlines, Mapping):
            return cls._matched(annotated_pictures(dict(outlines)), sources)
        if len(sources) != 1:
            raise ValueError(
                "a list of outlines is for one picture: for several, give a file (or its "
                "content) that names the picture of each outline"
            )
        return cls((AnnotatedPicture(tuple(_squares_of(outlines))),))

    @classmethod
    def _matched(cls, drawn: list[AnnotatedPicture], sources: Sequence[ImageSource]) -> Annotations:
        names = [_base_name(s) if isinstance(s, str | os.PathLike) else None for s in sources]
        found: list[list[AnnotatedPicture]] = [[] for _ in sources]
        if names == [None] and len(drawn) == 1 and drawn[0].index is None:
            return cls((drawn[0],))  # an array has no name that could differ
        for picture in drawn:
            for index in _picture_indices(picture, names):
                found[index].append(picture)
        if not any(found):
            raise ValueError(
                f"nothing is drawn on {_named(names)}: the outlines are for "
                f"{_named([picture.name for picture in drawn])}"
            )
        return cls(
            tuple(drawings[0].joined(drawings[1:]) if drawings else None for drawings in found)
        )

    def on(self, index: int, image_size: tuple[int, int]) -> tuple[AnnotatedSquare, ...]:
        """Return the outlines drawn on a picture of this size, possibly none.

        Raises
        ------
        ValueError
            If the outlines were drawn on a picture of another size, or reach outside.
        """
        drawn = self.of_pictures[index]
        if drawn is None:
            return ()
        drawn.check_size(image_size)
        for target in drawn.targets:
            target.check_inside(image_size)
        return drawn.targets


def _squares_of(outlines: Any) -> list[AnnotatedSquare]:
    if isinstance(outlines, bytes) or not hasattr(outlines, "__iter__"):
        raise TypeError(
            f"outlines must be a path, parsed JSON or a sequence, not {type(outlines).__name__}"
        )
    targets: list[AnnotatedSquare] = []
    for index, outline in enumerate(outlines):
        where = f"outlines[{index}]"
        if isinstance(outline, AnnotatedSquare):
            targets.append(outline)
        elif isinstance(outline, Mapping):
            raise TypeError(
                f"{where} is a JSON object, which needs the file that it is in: give that file's "
                "path, or all of its content, or corners, four points each"
            )
        elif _depth(outline) == 3:
            targets.append(AnnotatedSquare(AnnotatedOutline.of_sides(outline, where)))
        else:
            targets.append(AnnotatedSquare(AnnotatedOutline.of_polygon(outline, where)))
    if not targets:
        raise ValueError("no outline given")
    return targets


def _depth(value: Any) -> int:
    """Return how deeply lists are nested: two for points, three for polylines."""
    depth = 0
    while hasattr(value, "__len__") and not isinstance(value, str | Mapping) and len(value) > 0:
        value = value[0]
        depth += 1
    return depth


def _base_name(path: str | os.PathLike[str]) -> str:
    # Labelling programs on Windows write its separators; no photograph's name contains one.
    return PureWindowsPath(os.fspath(path)).name


def _picture_indices(picture: AnnotatedPicture, names: Sequence[str | None]) -> list[int]:
    """Return the indices of the pictures that a drawing belongs to."""
    if picture.index is not None:
        if picture.index >= len(names):
            raise ValueError(
                f'"{picture.where}index" is {picture.index}, but there are {len(names)} pictures '
                "(the first is 0)"
            )
        return [picture.index]
    if picture.name is None:
        if len(names) > 1:
            raise ValueError(
                "the outlines do not say which of the pictures they are for: give each an index or "
                "a file"
            )
        return [0]
    places = [i for i, name in enumerate(names) if name == _base_name(picture.name)]
    if len(places) > 1:
        raise ValueError(f"{len(places)} pictures are called {picture.name}: give indices instead")
    return places


def _named(names: Sequence[str | None]) -> str:
    return listed(["an array" if name is None else name for name in names], MAX_NAMED)
