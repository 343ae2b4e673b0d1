"""Pictures that a command draws, and the paths to which it writes them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trisquare._support.writing import PathLike, check_writable, write_atomically
from trisquare.drawing.detections import draw_detections
from trisquare.errors import ImageError, TrisquareError
from trisquare.images.drawn_mark import encode_drawn
from trisquare.images.encoding import check_picture_name
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import Image

DEEP_FORMATS = {
    "uint16": (".png", ".tif", ".tiff", ".jp2", ".pgm", ".ppm", ".pnm", ".pxm"),
    "float32": (".tif", ".tiff"),
}
"""Formats that keep such pixels; OpenCV would reduce them to 8 bits in any other."""


def numbered_paths(path: Path | None, photos: int) -> list[Path]:
    """Return one path per photograph: FILE.png itself, or FILE-1.png, FILE-2.png, ..."""
    if path is None:
        return []
    if photos == 1:
        return [path]
    return [path.with_name(f"{path.stem}-{number}{path.suffix}") for number in range(1, photos + 1)]


def check_file_named(path: str | Path) -> None:
    """Refuse the name ``-`` for a picture: it stands for standard output in other programs."""
    if str(path) == "-":
        raise ValueError("-: pictures cannot be written to standard output: name a file")


def check_outputs(
    inputs: Iterable[Path | None],
    pictures: Iterable[Path | None],
    others: Iterable[Path | None] = (),
) -> None:
    """Refuse outputs that cannot be written before anything is computed; None means no file."""
    taken = {os.path.realpath(path) for path in inputs if path is not None}
    drawings = [path for path in pictures if path is not None]
    for path in drawings:
        check_file_named(path)
    for path in (*drawings, *(path for path in others if path is not None)):
        check_writable(path)
        if os.path.realpath(path) in taken:
            raise ValueError(f"{path}: would overwrite an input or another output")
        taken.add(os.path.realpath(path))
    for path in drawings:
        check_picture_name(path)


def check_depth(picture: Image, path: Path) -> None:
    """Refuse a format that would reduce the depth of the photograph's pixels."""
    formats = DEEP_FORMATS.get(str(picture.dtype))
    if formats is not None and path.suffix.lower() not in formats:
        raise ValueError(
            f"{path}: this format does not store {picture.dtype} pixels; choose among "
            f"{', '.join(formats)}"
        )


def drawn(
    draw: Callable[..., Image], photographs: Photographs, paths: Sequence[Path], *what: Any
) -> dict[PathLike, bytes]:
    """Draw `what` over each photograph that has a path."""
    return {
        path: encode_drawn(draw(photograph.pixels, *what, index=photograph.index), path)
        for path, photograph in zip(paths, photographs, strict=False)
    }


@contextmanager
def drawn_on_failure(photographs: Photographs, paths: Sequence[Path]) -> Iterator[None]:
    """Write the debug pictures if the calibration fails."""
    try:
        yield
    except ImageError:
        raise  # there was no picture to search
    except TrisquareError as error:
        try:
            pictures = drawn(draw_detections, photographs, paths, error.found, error.rejected)
            write_atomically(pictures)
        except OSError as fault:  # must not hide why the calibration failed
            error.args = (f"{error}; the debug picture: {fault}",)
        raise
