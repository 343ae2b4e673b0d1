"""The camera file that a command writes, in the format of its name."""

from __future__ import annotations

from pathlib import Path

from trisquare.camera.camera import Camera
from trisquare.formats.base import Format
from trisquare.formats.load_save import written
from trisquare.formats.registry import ENDINGS, format_of_name


def camera_format(path: Path) -> Format:
    """Return the format that a file's name implies.

    Raises
    ------
    ValueError
        If it implies none.
    """
    return format_of_name(path.name, f"let it end with one of {', '.join(ENDINGS)}")


def camera_content(camera: Camera, path: Path) -> bytes:
    """Return the content of a camera's file with this name.

    Raises
    ------
    ValueError
        If the name implies no format.
    LensModelError
        If the format has no model for the camera.
    """
    suffix = path.suffix.lower()
    return written(camera, camera_format(path), suffix, approximate=False)[0].encode()
