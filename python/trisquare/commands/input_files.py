"""Files that a command reads besides photographs."""

from __future__ import annotations

import json
from pathlib import Path

from trisquare.camera import Camera
from trisquare.commands.input_errors import reading
from trisquare.formats import load_camera
from trisquare.formats.own import CALIBRATION_FORMAT
from trisquare.known_camera import lens_of
from trisquare.named_file import naming, read_text
from trisquare.rescaling import rescaled
from trisquare.result import Calibration


def read_camera(path: Path) -> Calibration | Camera:
    """Read a calibration with its uncertainty, or the camera that a file of any format holds."""
    with reading():
        loaded = load_camera(path)
        text = read_text(path) if loaded.format == "trisquare" else "{}"
    if json.loads(text).get("format") != CALIBRATION_FORMAT:
        return loaded.camera
    with naming(path):
        return Calibration.from_json(text)


def camera_alone(path: Path) -> Camera:
    """Read the camera that a file of any format holds, a calibration's included."""
    with reading():
        return load_camera(path).camera


def of_size(
    camera: Calibration | Camera, image_size: tuple[int, int], rescale: bool, what: str
) -> Calibration | Camera:
    """Return a camera for pictures of a size, scaled to it if that is allowed.

    Raises
    ------
    ValueError
        If the camera's pictures are of another size and `rescale` is not set, or of another shape.
    """
    lens = lens_of(camera)
    if lens.image_size == image_size:
        return camera
    with naming(what):
        scaled = rescaled(camera, image_size)
    if not rescale:
        own, other = ("{} x {}".format(*size) for size in (lens.image_size, image_size))
        raise ValueError(
            f"{what} has {other} pixels, the camera's pictures {own}: --rescale scales the camera, "
            "where they are the same picture in another resolution"
        )
    return scaled
