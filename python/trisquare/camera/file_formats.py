"""Where `Camera.save` and `Camera.load` find the camera files of other programs.

`trisquare.formats` registers itself here when it is imported: a camera knows that there are
files, and not which formats they have.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from trisquare.camera.approximation import Approximation
    from trisquare.camera.camera import Camera


class Loaded(Protocol):
    """What is read from a camera file."""

    @property
    def camera(self) -> Camera:
        """The camera."""


class CameraFiles(NamedTuple):
    """Reads and writes camera files; the arguments are those of `Camera.save` and `Camera.load`."""

    save: Callable[..., Approximation | None]
    load: Callable[..., Loaded]


_registered: list[CameraFiles] = []


def register_files(files: CameraFiles) -> None:
    """Let `Camera.save` and `Camera.load` use these readers and writers."""
    _registered[:] = [files]


def registered_files() -> CameraFiles:
    """Return the readers and writers that are registered."""
    return _registered[-1]
