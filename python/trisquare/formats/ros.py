"""ROS's ``camera_info`` YAML, as camera_calibration writes and camera_info_manager reads.

Pixels, ``(0, 0)`` the centre of the top-left one (OpenCV's convention, which image_geometry
inherits). Schema: sensor_msgs/CameraInfo as camera_calibration_parsers spells it, ``image_width``,
``image_height``, ``camera_name``, ``camera_matrix``, ``distortion_model``,
``distortion_coefficients``, ``rectification_matrix`` and ``projection_matrix``, matrices as rows,
cols and row-major data.

Written: ``plumb_bob`` (k1, k2, p1, p2, k3), ``rational_polynomial`` (and k4, k5, k6, s1 to s4) or
``equidistant`` (k1, k2, k3, k4), no rectification, a projection by K itself. Read: these, and
``fisheye``, another name of ``equidistant``; a tilted sensor as the nearest. A skew is neither
written nor read.
"""

from __future__ import annotations

import re

import numpy as np

from trisquare._support.json_members import JsonFields
from trisquare.camera.camera import Camera
from trisquare.camera.lens_models import BROWN, COEFFICIENTS, FISHEYE, RATIONAL, THIN_PRISM
from trisquare.formats.approximation import ANY_CAMERA, Lens
from trisquare.formats.base import Cameras, Format, ImageSize
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import check_opencv_matrix, fisheye_of, opencv_lens

LENGTHS = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (5, 8, 12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
}

WRITTEN = {
    BROWN: "plumb_bob",
    RATIONAL: "rational_polynomial",
    THIN_PRISM: "rational_polynomial",
    FISHEYE: "equidistant",
}


def recognises(document: Document) -> bool:
    """Return whether it has the keys ``distortion_model`` and ``camera_matrix``."""
    return not document.starts_with("{") and all(
        re.search(rf"^{key}\s*:", document.text, re.MULTILINE)
        for key in ("distortion_model", "camera_matrix")
    )


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the camera of a file."""
    members = document.yaml
    name = members.value("camera_name") if members.has("camera_name") else None
    return {name if isinstance(name, str) else "camera": lambda: _camera(members)}


def _camera(members: JsonFields) -> Lens:
    size = (members.integer("image_width"), members.integer("image_height"))
    K = members.object("camera_matrix").array("data", (9,)).reshape(3, 3)
    distortion = members.object("distortion_coefficients").array("data", (None,)).tolist()
    model = members.text("distortion_model")
    if model not in LENGTHS:
        raise ValueError(f'"distortion_model" must be one of {", ".join(LENGTHS)}, not {model!r}')
    if len(distortion) not in LENGTHS[model]:
        raise ValueError(
            f'"distortion_coefficients.data" has {len(distortion)} numbers; {model} has '
            f"{' or '.join(str(length) for length in LENGTHS[model])}"
        )
    check_opencv_matrix(K)
    if model in ("equidistant", "fisheye"):
        return fisheye_of(K, distortion, size)
    return opencv_lens(K, distortion, size)


def write(camera: Camera, suffix: str) -> str:
    """Write a camera."""
    width, height = camera.image_size
    coefficients = camera.distortion.tolist()
    projection = np.column_stack([camera.K, np.zeros(3)])
    lines = [
        f"image_width: {width}",
        f"image_height: {height}",
        "camera_name: camera",
        *_matrix("camera_matrix", 3, 3, camera.K.ravel().tolist()),
        f"distortion_model: {WRITTEN[COEFFICIENTS[camera.model]]}",
        *_matrix("distortion_coefficients", 1, len(coefficients), coefficients),
        *_matrix("rectification_matrix", 3, 3, np.eye(3).ravel().tolist()),
        *_matrix("projection_matrix", 3, 4, projection.ravel().tolist()),
    ]
    return "\n".join(lines) + "\n"


def _matrix(name: str, rows: int, columns: int, data: list[float]) -> list[str]:
    numbers = ", ".join(yaml_real(value) for value in data)
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{numbers}]"]


def yaml_real(value: float) -> str:
    """Write a number in a form that YAML 1.1 reads as one: with a point before an exponent."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


FORMAT = Format(
    name="ros",
    title="ROS's camera_info YAML",
    recognises=recognises,
    read=read,
    write=write,
    families=ANY_CAMERA,
    file_names=("camera_info.yaml", "camera_info.yml"),
)
