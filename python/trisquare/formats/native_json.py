"""trisquare's own JSON: a camera, or the camera of a `Calibration`.

Pixels, ``(0, 0)`` the centre of the top-left one; the model, its coefficients and the valid radius
as `Camera` has them, so that it reads back exactly. Schema: ``{"format": "trisquare-camera/1",
"software", "image_size": [w, h], "camera": {"model", "fx", "fy", "cx", "cy", "skew" unless it is 0,
"distortion": [k1, k2, p1, p2, k3] or, of a fisheye, [k1, k2, k3, k4], "valid_radius"}}``; unknown
keys are ignored.
"""

from __future__ import annotations

import re
import reprlib
from dataclasses import replace

from trisquare._core import __version__
from trisquare._support.json_members import JsonFields, dump_members
from trisquare.camera.camera import Camera
from trisquare.camera.members import camera_from_members, camera_members
from trisquare.formats.approximation import ANY_CAMERA
from trisquare.formats.base import Cameras, Format, ImageSize, only, size_member
from trisquare.formats.document import Document

CAMERA_FORMAT = "trisquare-camera/1"
CALIBRATION_FORMAT = "trisquare/1"
VERSIONED = re.compile(r"trisquare(?:-camera)?/(\d{1,9})")


def recognises(document: Document) -> bool:
    """Return whether there is a ``format`` that begins with trisquare's name."""
    return re.search(r'"format"\s*:\s*"trisquare', document.text[:4096]) is not None


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read a camera, or that of a calibration."""
    return only(lambda: _camera(document.json))


def _camera(members: JsonFields) -> Camera:
    if not members.has("format") and not members.has("result"):
        raise ValueError(
            '"format" is missing: the JSON of trisquare, of OpenCV and of nerfstudio is read'
        )
    found = members.text("format")
    if found not in (CAMERA_FORMAT, CALIBRATION_FORMAT):
        version = VERSIONED.fullmatch(found)
        if version is not None and int(version[1]) > 1:
            raise ValueError(
                f'"format" is {found!r}, newer than this trisquare {__version__} reads: update it'
            )
        raise ValueError(
            f'"format" must be {CAMERA_FORMAT!r} or {CALIBRATION_FORMAT!r}, '
            f"not {reprlib.repr(found)}"
        )
    return camera_from_members(members.object("camera"), size_member(members, "image_size"))


def write(camera: Camera, suffix: str) -> str:
    """Write a camera."""
    return camera_json(camera)


def camera_from_json(text: str) -> Camera:
    """Read a camera; see `Camera.from_json`."""
    return _camera(JsonFields.parse(text))


def camera_json(camera: Camera) -> str:
    """Write a camera; see `Camera.to_json`."""
    return dump_members(
        {
            "format": CAMERA_FORMAT,
            "software": __version__,
            "image_size": list(camera.image_size),
            "camera": camera_members(camera),
        }
    )


FORMAT = Format(
    name="trisquare",
    title="trisquare's JSON",
    recognises=recognises,
    read=read,
    write=write,
    families=tuple(replace(family, skewed=True) for family in ANY_CAMERA),
    file_names=(".json",),
)
