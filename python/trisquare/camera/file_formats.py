"""Registry of the readers and writers of camera files for `Camera.save` and `Camera.load`.

`trisquare.formats` registers itself here when it is imported, which happens when the first camera
is saved or loaded: this module does not depend on the formats.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, Protocol

from trisquare._support.paths import File

if TYPE_CHECKING:
    from trisquare.camera.approximation import Approximation
    from trisquare.camera.camera import Camera


class Loaded(Protocol):
    """The content of a camera file."""

    @property
    def camera(self) -> Camera:
        """The camera."""


class CameraFiles(NamedTuple):
    """Functions that read and write camera files, with arguments as `Camera.save` and `load`.

    `is_own` returns whether a path and a format, or None, mean trisquare's own format, which may
    also have results; it raises ValueError if the name implies no format. `to_json` and `from_json`
    convert between a camera and trisquare's own JSON.
    """

    save: Callable[..., Approximation | None]
    load: Callable[..., Loaded]
    is_own: Callable[[File, str | None], bool]
    to_json: Callable[[Camera], str]
    from_json: Callable[[str], Camera]


_registered: list[CameraFiles] = []


def register_files(files: CameraFiles) -> None:
    """Register the functions that `Camera.save` and `Camera.load` use."""
    _registered[:] = [files]


def registered_files() -> CameraFiles:
    """Return the registered functions; they are imported first."""
    import_module("trisquare.formats")
    return _registered[-1]
