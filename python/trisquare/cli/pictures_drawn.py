"""The pictures that a command draws, and where it writes them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from trisquare._support.writing import PathLike, check_writable, write_atomically
from trisquare.drawing.detections import draw_detections
from trisquare.drawing.overlay import draw_overlay
from trisquare.errors import ImageError, TrisquareError
from trisquare.images.encoding import check_picture_name, encode_image
from trisquare.images.photographs import Photographs
from trisquare.results.calibration import Calibration
from trisquare.results.partial_detection import PartialDetection
from trisquare.results.plane import Plane
from trisquare.results.rejected import Rejected


def numbered_paths(path: Path | None, photos: int) -> list[Path]:
    """One path for each photograph: FILE.png itself, or FILE-1.png, FILE-2.png, ..."""
    if path is None:
        return []
    if photos == 1:
        return [path]
    return [path.with_name(f"{path.stem}-{number}{path.suffix}") for number in range(1, photos + 1)]


def check_outputs(
    inputs: Sequence[Path],
    output: Path | None,
    drawings: Sequence[Path],
    report: Path | None = None,
) -> None:
    """Refuse outputs that cannot be written before anything is computed."""
    taken = {os.path.realpath(path) for path in inputs}
    for path in (*drawings, *(path for path in (output, report) if path is not None)):
        check_writable(path)
        if os.path.realpath(path) in taken:
            raise ValueError(f"{path}: would overwrite an input or another output")
        taken.add(os.path.realpath(path))
    for path in drawings:
        check_picture_name(path)


def overlays(
    calibration: Calibration, photographs: Photographs, paths: Sequence[Path]
) -> dict[PathLike, bytes]:
    """Draw the calibration over each photograph that a path is given for."""
    return {
        path: encode_image(
            draw_overlay(photograph.pixels, calibration, index=photograph.index), path
        )
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
        write_atomically(debug_pictures(photographs, paths, error.found, error.rejected))
        raise


def debug_pictures(
    photographs: Photographs,
    paths: Sequence[Path],
    found: Sequence[Plane | PartialDetection],
    rejected: Sequence[Rejected],
) -> dict[PathLike, bytes]:
    """Draw what was found in each photograph that a path is given for."""
    return {
        path: encode_image(
            draw_detections(photograph.pixels, found, rejected, index=photograph.index), path
        )
        for path, photograph in zip(paths, photographs, strict=False)
    }
