"""The pictures that a command draws, and where it writes them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from trisquare._support.writing import PathLike, check_writable, write_atomically
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.kinds import TargetKinds
from trisquare.drawing.detections import draw_detections
from trisquare.drawing.overlay import draw_overlay
from trisquare.errors import ImageError, TrisquareError
from trisquare.images.encoding import check_picture_name, encode_image
from trisquare.images.pixels import picture_size
from trisquare.images.reading import read_image
from trisquare.measurement.detect import detect
from trisquare.measurement.rejection_reasons import rejection_reasons
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


def overlay_of(
    calibration: Calibration,
    photo: Path,
    index: int,
    path: Path,
    targets: str,
    tone: str | float | None,
    drawings: Annotations | None,
) -> bytes:
    """Draw the calibration over a photograph; returns the content of the file at `path`."""
    image = read_image(photo)
    edges = []
    # A picture among several in which there is nothing has no edges to draw.
    if any(plane.image == index for plane in calibration.planes):
        drawn = None if drawings is None else drawings.on(index, picture_size(image))
        edges = detect(image, targets=targets, tone=tone, outlines=drawn)
    edges = [replace(figure, image=index) for figure in edges]
    return encode_image(draw_overlay(image, calibration, edges, index=index), path)


@contextmanager
def drawn_on_failure(
    photos: Sequence[Path], paths: Sequence[Path], targets: TargetKinds
) -> Iterator[None]:
    """Write the debug pictures if the calibration fails."""
    try:
        yield
    except ImageError:
        raise  # there was no picture to search
    except TrisquareError as error:
        write_atomically(debug_pictures(photos, paths, targets, error.found, error.rejected))
        raise


def debug_pictures(
    photos: Sequence[Path],
    paths: Sequence[Path],
    targets: TargetKinds,
    found: Sequence[Plane | PartialDetection],
    rejected: Sequence[Rejected],
) -> dict[PathLike, bytes]:
    """Draw what was found in each photograph that a path is given for."""
    contents: dict[PathLike, bytes] = {}
    for index, (photo, path) in enumerate(zip(photos, paths, strict=False)):
        image = read_image(photo)
        # An error already holds the rejected shapes of some pictures.
        known = {candidate.corners.tobytes() for candidate in rejected if candidate.image == index}
        further = [
            replace(candidate, image=index)
            for candidate in rejection_reasons(image, targets)
            if candidate.corners.tobytes() not in known
        ]
        drawn = draw_detections(image, found, [*rejected, *further], index=index)
        contents[path] = encode_image(drawn, path)
    return contents
