"""Where `Camera.save` and `Camera.load` find the camera files of other programs.

`trisquare.formats` registers itself here when it is imported, which the first camera that is saved
or loaded does: a camera knows that there are files, and not which formats they have.
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
    """What is read from a camera file."""

    @property
    def camera(self) -> Camera:
        """The camera."""


class CameraFiles(NamedTuple):
    """Reads and writes camera files; the arguments are those of `Camera.save` and `Camera.load`.

    `is_own` says of a path and a format, or None, whether that is trisquare's own, which holds
    results as well; it raises ValueError where the name tells no format. `to_json` and `from_json`
    are between a camera and trisquare's own JSON.
    """

    save: Callable[..., Approximation | None]
    load: Callable[..., Loaded]
    is_own: Callable[[File, str | None], bool]
    to_json: Callable[[Camera], str]
    from_json: Callable[[str], Camera]


_registered: list[CameraFiles] = []


def register_files(files: CameraFiles) -> None:
    """Let `Camera.save` and `Camera.load` use these readers and writers."""
    _registered[:] = [files]


def registered_files() -> CameraFiles:
    """Return the readers and writers that are registered, once they are loaded."""
    import_module("trisquare.formats")
    return _registered[-1]
