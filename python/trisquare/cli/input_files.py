"""Files that a command reads besides photographs."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from glob import has_magic
from pathlib import Path

import numpy as np

from trisquare._support.paths import naming
from trisquare.calibration.known_camera import known_camera
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.cli.framework import UnreadableInputError, reading
from trisquare.cli.options import STANDARD_INPUT
from trisquare.errors import MissingImageError
from trisquare.formats import load_camera
from trisquare.images.drawn_mark import is_drawn
from trisquare.images.limits import PictureLimits
from trisquare.images.pixels import ImageSource
from trisquare.images.sources import sources_of
from trisquare.results.calibration import Calibration


def read_camera(path: Path) -> Calibration | Camera:
    """Read a calibration with its uncertainty, or the camera of a file of any format."""
    with reading():
        return known_camera(path)


def camera_alone(path: Path) -> Camera:
    """Read the camera of a file of any format, also of a calibration."""
    with reading():
        return load_camera(path).camera


INPUT = Path(STANDARD_INPUT)


def photographs_named(paths: Iterable[Path], *, with_videos: bool = False) -> list[Path]:
    """Return the photographs of the arguments: files, contents of folders, matches of patterns.

    Videos in folders are included `with_videos`. Pictures that trisquare drew on are left out if
    there are others: shells may have expanded a pattern.

    Raises
    ------
    ImageError
        If a folder has none, or no file matches a pattern; `MissingImageError` for a word that is
        not a file, and may be the value of an option.
    """
    paths = list(paths)
    if paths.count(INPUT) > 1:
        raise ValueError("- is standard input, which contains one picture: give it once")
    for path in paths:
        if path == INPUT:
            continue
        if not (path.suffix or path.name != str(path) or path.exists() or has_magic(path.name)):
            raise MissingImageError(
                f"{path}: No such file or directory. If it is meant for an option: several values "
                "are joined by commas (--fix aspect,principal_point), and a value contains no "
                "space (--side 84mm)",
                path,
            )
    photograph_paths = [path for path in paths if path == INPUT or not is_drawn(path)] or paths
    photos: list[Path] = []
    for path in photograph_paths:
        found = [path] if path == INPUT else sources_of(path, with_videos=with_videos)
        photos += [Path(str(path_text)) for path_text in found]
    return photos


def with_content_of_input(photos: Iterable[Path], limits: PictureLimits) -> list[ImageSource]:
    """Return photographs with `INPUT` replaced by its content."""
    return [photo if photo != INPUT else _content_of_input(limits) for photo in photos]


def _content_of_input(limits: PictureLimits) -> bytes:
    if sys.stdin is None:
        raise UnreadableInputError("standard input is closed")
    return sys.stdin.buffer.read(limits.max_bytes + 1)  # one byte more is enough to refuse it


def of_size(
    camera: Calibration | Camera, image_size: tuple[int, int], rescale: bool, what: str
) -> Calibration | Camera:
    """Return a camera for pictures of a size, scaled to it if that is allowed.

    Raises
    ------
    ValueError
        If the camera's pictures are of another size and `rescale` is not set, or have another
        aspect ratio.
    """
    lens = camera_of(camera)
    if lens.image_size == image_size:
        return camera
    with naming(what):
        scaled = rescaled(camera, image_size)
    if not rescale:
        camera_text, picture_text = (
            "{} x {}".format(*size) for size in (lens.image_size, image_size)
        )
        raise ValueError(
            f"{what}: the camera's pictures are {camera_text}, not {picture_text}: use --rescale "
            "if only the resolution differs"
        )
    return scaled


# Axis of each parameter that is in pixels.
IN_PIXELS = {"fx": 0, "fy": 1, "cx": 0, "cy": 1, "skew": 0}


def rescaled(camera: Calibration | Camera, image_size: tuple[int, int]) -> Calibration | Camera:
    """Scale a camera, with its covariance if there is one, by the rule of `Camera.rescaled`.

    Planes and other data in pixels of the original size are left out.

    Raises
    ------
    TypeError, ValueError
        As `Camera.rescaled`.
    """
    if isinstance(camera, Camera):
        return camera.rescaled(image_size)
    scaled = camera.camera.rescaled(image_size)
    ratios = np.divide(scaled.image_size, camera.camera.image_size)
    by_name = {name: float(ratios[axis]) for name, axis in IN_PIXELS.items()}
    factors = np.array([by_name.get(name, 1.0) for name in camera.parameters])
    return replace(
        camera,
        camera=scaled,
        covariance=factors[:, None] * camera.covariance * factors,
        std={name: by_name.get(name, 1.0) * std for name, std in camera.std.items()},
        rms=camera.rms * float(np.sqrt(np.prod(ratios))),
        planes=(),
        rejected=(),
        alternatives=(),
        coherence=None,
        edges=(),
        residuals=(),
        pictures=(),
    )
