"""Kalibr's ``camchain.yaml``.

Pixels, ``(0, 0)`` the centre of the top-left one (its corners come from OpenCV). Schema: Kalibr's
wiki, page "Yaml formats": for ``cam0``, ``cam1``, ... a ``camera_model`` with its ``intrinsics``
[fu, fv, pu, pv], a ``distortion_model`` with its ``distortion_coeffs``, the ``resolution`` [width,
height] and the ``rostopic``.

Written: ``pinhole`` with ``radtan`` (k1, k2, p1, p2), which has no k3, or with
``equidistant`` (k1, k2, k3, k4). Read: these, and ``none``.
"""

from __future__ import annotations

import re
from functools import partial

from trisquare._support.json_members import JsonFields
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.camera.lens_models import FISHEYE, is_fisheye
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.base import Cameras, Format, ImageSize, size_member
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import fisheye_of, opencv_lens
from trisquare.formats.ros import yaml_real

CAMERA_NAME = re.compile(r"cam\d{1,4}")


def recognises(document: Document) -> bool:
    """Return whether a member has the name cam0 or the like."""
    return re.search(r"^cam\d+\s*:", document.text, re.MULTILINE) is not None


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the cameras of a chain: cam0, cam1, ..."""
    members = document.yaml
    names = [name for name in members.names() if CAMERA_NAME.fullmatch(name)]
    if not names:
        raise ValueError('"cam0" is missing')
    return {name: partial(_camera_called, name, members) for name in names}


def _camera_called(name: str, members: JsonFields) -> Lens:
    return _camera(members.object(name))


def _camera(members: JsonFields) -> Lens:
    if members.text("camera_model") != "pinhole":
        raise ValueError(
            f'"camera_model" is {members.text("camera_model")!r}: only pinhole can be read'
        )
    K = camera_matrix(*members.array("intrinsics", (4,)).tolist())
    size = size_member(members, "resolution")
    model = members.text("distortion_model")
    if model == "none":
        return opencv_lens(K, (), size)
    distortion = members.array("distortion_coeffs", (4,)).tolist()
    if model == "equidistant":
        return fisheye_of(K, distortion, size)
    if model == "radtan":
        return opencv_lens(K, distortion, size)
    raise ValueError(f'"distortion_model" is {model!r}: only radtan, equidistant and none are read')


def write(camera: Camera, suffix: str) -> str:
    """Write a chain of one camera."""
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    lines = [
        "cam0:",
        "  cam_overlaps: []",
        "  camera_model: pinhole",
        f"  distortion_coeffs: {_numbers(camera.distortion.tolist()[:4])}",
        f"  distortion_model: {'equidistant' if is_fisheye(camera.model) else 'radtan'}",
        f"  intrinsics: {_numbers(intrinsics)}",
        f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]",
        "  rostopic: /cam0/image_raw",
    ]
    return "\n".join(lines) + "\n"


def _numbers(values: list[float] | tuple[float, ...]) -> str:
    return f"[{', '.join(yaml_real(value) for value in values)}]"


FORMAT = Format(
    name="kalibr",
    title="Kalibr's camchain.yaml",
    recognises=recognises,
    read=read,
    write=write,
    families=(
        Family("equidistant (k1, k2, k3, k4)", FISHEYE, all_coefficients=FISHEYE),
        Family("radtan (k1, k2, p1, p2)", ("k1", "k2", "p1", "p2")),
    ),
    file_names=("camchain.yaml", "camchain.yml"),
)
