"""File formats for the exchange of cameras with other programs, one module each."""

from __future__ import annotations

from trisquare.camera.approximation import Approximation
from trisquare.camera.file_formats import CameraFiles, register_files
from trisquare.errors import LensModelError
from trisquare.formats import native_json
from trisquare.formats.load_save import Loaded, is_own, load_camera, save_camera
from trisquare.formats.registry import FORMAT_NAMES

__all__ = [
    "FORMAT_NAMES",
    "Approximation",
    "LensModelError",
    "Loaded",
    "load_camera",
    "save_camera",
]

register_files(
    CameraFiles(
        save=save_camera,
        load=load_camera,
        is_own=is_own,
        to_json=native_json.camera_json,
        from_json=native_json.camera_from_json,
    )
)
