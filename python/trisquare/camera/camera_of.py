"""The camera of an argument: a camera itself, or a result with a camera."""

from __future__ import annotations

import os
from typing import Protocol

from trisquare.camera.camera import Camera


class HasCamera(Protocol):
    """A result with a camera: a `Calibration`."""

    @property
    def camera(self) -> Camera:
        """The camera."""


def camera_of(given: HasCamera | Camera, name: str = "camera") -> Camera:
    """Return the camera itself, or the camera of a calibration.

    Raises
    ------
    TypeError
        If it is neither; the message uses `name` for it.
    """
    camera = given if isinstance(given, Camera) else getattr(given, "camera", None)
    if isinstance(camera, Camera):
        return camera
    hint = ": read a file by Camera.load" if isinstance(given, str | os.PathLike) else ""
    raise TypeError(f"{name} must be a Calibration or a Camera, not {type(given).__name__}{hint}")
