"""The camera of a file, with its uncertainty if the file states one."""

from __future__ import annotations

from trisquare._support.paths import naming
from trisquare._support.writing import PathLike
from trisquare.camera.camera import Camera
from trisquare.formats.document import Document
from trisquare.formats.load_save import camera_of_document
from trisquare.formats.native_json import CALIBRATION_FORMAT
from trisquare.results.calibration import Calibration


def known_camera(path: PathLike) -> Calibration | Camera:
    """Read a calibration, or the camera of a file of any format.

    Raises
    ------
    ValueError
        If it is not a camera file, or damaged.
    OSError
        If it cannot be read.
    """
    document = Document.read(path)
    loaded = camera_of_document(document, path)
    with naming(path):
        if loaded.format != "trisquare" or document.json.value("format") != CALIBRATION_FORMAT:
            return loaded.camera
        return Calibration.from_json(document.text)
