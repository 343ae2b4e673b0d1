"""The camera of a file, with its uncertainty where the file states one."""

from __future__ import annotations

import json

from trisquare._support.paths import naming, read_text
from trisquare._support.writing import PathLike
from trisquare.camera.camera import Camera
from trisquare.formats import load_camera
from trisquare.formats.native_json import CALIBRATION_FORMAT
from trisquare.results.calibration import Calibration


def known_camera(path: PathLike) -> Calibration | Camera:
    """Read a calibration, or the camera that a file of any format holds.

    Raises
    ------
    ValueError
        If it is no camera file, or damaged.
    OSError
        If it cannot be read.
    """
    loaded = load_camera(path)
    text = read_text(path) if loaded.format == "trisquare" else "{}"
    if json.loads(text).get("format") != CALIBRATION_FORMAT:
        return loaded.camera
    with naming(path):
        return Calibration.from_json(text)
