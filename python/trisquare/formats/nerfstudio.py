"""nerfstudio's ``transforms.json``, and that of instant-ngp, its predecessor.

Pixels, with ``(0, 0)`` at the top-left **corner** of the top-left one (nerfstudio samples pixels at
their centres by adding half a pixel, and subtracts it for OpenCV), so that a principal point is
half a pixel larger than trisquare's in each coordinate. Schema: nerfstudio's documentation, "Data
conventions": ``camera_model``, ``fl_x``, ``fl_y``, ``cx``, ``cy``, ``w``, ``h``, ``k1`` to ``k4``,
``p1``, ``p2`` for all frames, or for each of ``frames``; its k3 and k4 are the coefficients of r^6
and r^8.

Written: OPENCV or OPENCV_FISHEYE, without frames. Read: these and the simpler variants of OPENCV;
OPENCV with k4 as the nearest. Cameras of frames with intrinsics of their own are named by
``file_path``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

import numpy as np

from trisquare._support.json_members import JsonFields, dump_members
from trisquare.camera.camera import Camera, camera_matrix, camera_parameters
from trisquare.camera.lens_models import is_fisheye
from trisquare.formats.approximation import ANY_BROWN, ANY_FISHEYE, Lens
from trisquare.formats.base import Cameras, Format, ImageSize, only
from trisquare.formats.colmap import HALF_PIXEL
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import ForeignLens, fisheye_of, simplest_camera

COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
PINHOLE_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
FOCAL_KEYS = ("fl_x", "camera_angle_x")
VERTICAL_KEYS = ("fl_y", "camera_angle_y")


def recognises(document: Document) -> bool:
    """Return whether it is JSON with focal lengths under these names, or with frames."""
    return document.starts_with("{") and bool(
        re.search(r'"(fl_x|camera_angle_x|frames)"\s*:', document.text)
    )


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the camera of all frames, or that of each frame."""
    members = document.json
    shared = any(members.has(key) for key in FOCAL_KEYS)
    if shared or not members.has("frames"):
        return only(partial(_camera, members, members))
    cameras: dict[str, Callable[[], Lens]] = {}
    for index, frame in enumerate(members.objects("frames")):
        name = frame.text("file_path") if frame.has("file_path") else f"frames[{index}]"
        cameras[name] = partial(_camera, frame, members)
    if not cameras:
        raise ValueError('"fl_x" is missing, and there are no frames that have one')
    return cameras


def _camera(members: JsonFields, shared: JsonFields) -> Lens:
    """Read a frame's intrinsics; those that it lacks are taken from all frames'."""

    def number(key: str, default: float) -> float:
        return members.number_or(key, shared.number_or(key, default))

    width, height = (_holder(members, shared, key).number(key) for key in ("w", "h"))
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f'"w" and "h" must be whole numbers, not {width:g} and {height:g}')
    size = (int(width), int(height))
    fl_x = _focal(_holder(members, shared, *FOCAL_KEYS), "x", width)
    vertical = _holder(members, shared, *VERTICAL_KEYS)
    fl_y = _focal(vertical, "y", height) if any(map(vertical.has, VERTICAL_KEYS)) else fl_x
    # By default the picture's centre, as in instant-ngp.
    centre = (number("cx", width / 2) - HALF_PIXEL, number("cy", height / 2) - HALF_PIXEL)
    K = camera_matrix(fl_x, fl_y, *centre)
    named = {key: number(key, 0.0) for key in COEFFICIENTS}
    model = _model(members, shared)
    if model == "OPENCV_FISHEYE":
        coefficients = [named[key] for key in ("k1", "k2", "k3", "k4")]
        return fisheye_of(K, coefficients, size)
    if model not in PINHOLE_MODELS:
        raise ValueError(
            f'"camera_model" is {model!r}; of nerfstudio\'s these can be read: '
            f"{', '.join(PINHOLE_MODELS)}, OPENCV_FISHEYE"
        )
    if named["k4"]:
        return ForeignLens(
            "nerfstudio's OPENCV model with k4",
            K,
            size,
            " ".join(named),
            list(named.values()),
        )
    return simplest_camera(K, named, size)


def _model(members: JsonFields, shared: JsonFields) -> str:
    """Return nerfstudio's name of the model; instant-ngp states only whether it is a fisheye."""
    holder = _holder(members, shared, "camera_model")
    if holder.has("camera_model"):
        return holder.text("camera_model")
    holder = _holder(members, shared, "is_fisheye")
    is_fisheye = holder.has("is_fisheye") and holder.truth("is_fisheye")
    return "OPENCV_FISHEYE" if is_fisheye else "OPENCV"


def _holder(members: JsonFields, shared: JsonFields, *keys: str) -> JsonFields:
    """Return a frame's own members if one of the keys is among them, else those of all frames."""
    return members if any(map(members.has, keys)) else shared


def _focal(members: JsonFields, axis: str, side: float) -> float:
    """Return a focal length, as stated or by the angle of view over the side of the picture."""
    length, angle_of_view = f"fl_{axis}", f"camera_angle_{axis}"
    if members.has(length) or not members.has(angle_of_view):
        return members.number(length)
    angle = members.number(angle_of_view)
    if not 0 < angle < np.pi:
        raise ValueError(f'"{angle_of_view}" must be from 0 to pi, not {angle:g}')
    return float(0.5 * side / np.tan(0.5 * angle))


def write(camera: Camera, suffix: str) -> str:
    """Write a file that is complete except for its frames."""
    named = dict.fromkeys(COEFFICIENTS, 0.0) | camera_parameters(camera)
    return dump_members(
        {
            "camera_model": "OPENCV_FISHEYE" if is_fisheye(camera.model) else "OPENCV",
            "w": camera.image_size[0],
            "h": camera.image_size[1],
            "fl_x": camera.fx,
            "fl_y": camera.fy,
            "cx": camera.cx + HALF_PIXEL,
            "cy": camera.cy + HALF_PIXEL,
            **{name: named[name] for name in COEFFICIENTS},
            "frames": [],
        }
    )


FORMAT = Format(
    name="nerfstudio",
    title="nerfstudio's transforms.json",
    recognises=recognises,
    read=read,
    write=write,
    families=(ANY_FISHEYE, ANY_BROWN),
    file_names=("transforms.json",),
)
