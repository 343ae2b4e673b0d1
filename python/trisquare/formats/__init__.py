"""The formats in which cameras go from one program to another, one module each."""

from __future__ import annotations

from trisquare.errors import LensModelError
from trisquare.formats.files import Loaded, load_camera, save_camera
from trisquare.formats.nearest import Approximation
from trisquare.formats.registry import FORMAT_NAMES

__all__ = [
    "FORMAT_NAMES",
    "Approximation",
    "LensModelError",
    "Loaded",
    "load_camera",
    "save_camera",
]
