"""OpenCV's FileStorage, in YAML, XML or JSON.

Pixels, ``(0, 0)`` the centre of the top-left one: trisquare's own convention. Members
``camera_matrix`` (3 x 3), ``distortion_coefficients`` (k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[,
tx, ty]]]]), ``image_width`` and ``image_height``, as OpenCV's calibration sample writes them
(samples/cpp/calibration.cpp); other common names are read too, and matrices as nested lists, which
scripts that dump arrays write. If a file does not state the size, the caller must. The syntax of a
written file follows its extension: ``.xml``, ``.json``, else YAML.

A fisheye has four coefficients, as a pinhole may have: ``fisheye_model: 1``, which that sample also
writes, distinguishes them.

Read: all of these; a tilted sensor (tx, ty) as the nearest. A skew is neither written nor read.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

from trisquare._support.arrays import FloatArray
from trisquare._support.json_members import JsonFields
from trisquare.camera.camera import Camera
from trisquare.camera.lens_models import FISHEYE, OPENCV_LENGTHS, is_fisheye
from trisquare.formats.approximation import ANY_CAMERA, Lens
from trisquare.formats.base import SAY_THE_SIZE, Cameras, Format, ImageSize, only
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import check_opencv_matrix, fisheye_of, opencv_lens
from trisquare.formats.xml_text import parse_xml
from trisquare.formats.yaml_text import MAX_CHARACTERS

MATRIX_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "mtx")
DISTORTION_NAMES = (
    *("distortion_coefficients", "Distortion_Coefficients", "distCoeffs"),
    *("dist_coeffs", "D", "dist"),
)
WIDTH_NAMES = ("image_width", "image_Width", "imageWidth", "width")
HEIGHT_NAMES = ("image_height", "image_Height", "imageHeight", "height")
FISHEYE_NAME = "fisheye_model"
LENGTHS = (0, *OPENCV_LENGTHS)
AS_LISTS = re.compile(
    # Spaces and tabs, not \s, which would make the search of hostile files take minutes.
    rf'^[ \t]*"?({"|".join(MATRIX_NAMES)})"?[ \t]*:(?:[ \t]*\n)?[ \t]*(\[|-[ \t])',
    re.MULTILINE,
)
"""A camera matrix as a list in YAML."""


def recognises(document: Document) -> bool:
    """Return whether it is FileStorage's XML, or has its tagged matrices or lists by its names."""
    if document.starts_with("<"):
        return "<opencv_storage" in document.text[:4096]
    is_any = re.search(r"opencv-(nd-)?matrix", document.text) or _has_lists(document)
    return bool(is_any) and not re.search(r'^"?distortion_model"?\s*:', document.text, re.MULTILINE)


def _has_lists(document: Document) -> bool:
    if not document.starts_with("{"):
        # A longer text is not read as YAML, and may be another program's.
        return AS_LISTS.search(document.text[:MAX_CHARACTERS]) is not None
    try:
        members = document.json
    except ValueError:
        return False
    name = _name(members, MATRIX_NAMES)
    return members.has(name) and isinstance(members.value(name), list)


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read a camera; `image_size` is needed if the file does not state it."""
    return only(lambda: _camera(_members(document), image_size))


def _members(document: Document) -> JsonFields:
    if document.starts_with("<"):
        return JsonFields({child.tag: _xml_value(child) for child in parse_xml(document.text)})
    return document.json if document.starts_with("{") else document.yaml


def _camera(members: JsonFields, image_size: ImageSize | None) -> Lens:
    K = _matrix(members, MATRIX_NAMES)
    K = K.reshape(3, 3) if K.shape == (9,) else K
    if K.shape != (3, 3):
        raise ValueError(f'"{_name(members, MATRIX_NAMES)}" must be 3 x 3, not {K.shape}')
    distortion = _matrix(members, DISTORTION_NAMES).ravel()
    if len(distortion) not in LENGTHS:
        raise ValueError(
            f'"{_name(members, DISTORTION_NAMES)}" has {len(distortion)} coefficients; OpenCV has '
            "4, 5, 8, 12 or 14"
        )
    check_opencv_matrix(K)
    if members.number_or(FISHEYE_NAME, 0.0):
        if len(distortion) != len(FISHEYE):
            raise ValueError(f"a fisheye has {len(FISHEYE)} coefficients, not {len(distortion)}")
        return fisheye_of(K, distortion.tolist(), _size(members, image_size))
    return opencv_lens(K, distortion.tolist(), _size(members, image_size))


def _size(members: JsonFields, image_size: ImageSize | None) -> ImageSize:
    if not any(members.has(name) for name in WIDTH_NAMES) and image_size is not None:
        return image_size
    if not any(members.has(name) for name in WIDTH_NAMES):
        raise ValueError(
            f'"image_width" and "image_height", the picture\'s size, are missing: {SAY_THE_SIZE}'
        )
    return (
        members.integer(_name(members, WIDTH_NAMES)),
        members.integer(_name(members, HEIGHT_NAMES)),
    )


def _name(members: JsonFields, names: tuple[str, ...]) -> str:
    """Return the name that the file uses, or the usual one."""
    return next((name for name in names if members.has(name)), names[0])


def _matrix(members: JsonFields, names: tuple[str, ...]) -> FloatArray:
    name = _name(members, names)
    stated = members.value(name)
    if isinstance(stated, list):
        is_nested = any(isinstance(row, list) for row in stated)
        return members.array(name, (None, None) if is_nested else (None,))
    matrix = members.object(name)
    data = matrix.array("data", (None,))
    # Arrays of one dimension, as written by OpenCV since version 5.
    if matrix.has("sizes") and not matrix.has("rows"):
        return data
    rows, columns = matrix.integer("rows"), matrix.integer("cols")
    if rows < 0 or columns < 0 or rows * columns != len(data):
        raise ValueError(f'"{name}.data" has {len(data)} numbers, not {rows} x {columns}')
    return data.reshape(rows, columns)


def _xml_value(element: ElementTree.Element) -> Any:
    if element.get("type_id") not in ("opencv-matrix", "opencv-nd-matrix"):
        return _number(element.text or "")
    members: dict[str, Any] = {part.tag: _number(part.text or "") for part in element}
    data = element.find("data")
    if data is not None:
        members["data"] = [_number(word) for word in (data.text or "").split()]
    return members


def _number(text: str) -> Any:
    """Return a number, or the text itself if it is not one, which later checks refuse."""
    for kind in (int, float):
        try:
            return kind(text.strip())
        except ValueError:
            continue
    return text


def write(camera: Camera, suffix: str) -> str:
    """Write a camera in the syntax of the extension."""
    writers = {".xml": _xml, ".json": _json}
    width, height = camera.image_size
    numbers = {"image_width": width, "image_height": height}
    if is_fisheye(camera.model):
        numbers[FISHEYE_NAME] = 1
    coefficients = camera.distortion.tolist()
    matrices = {
        "camera_matrix": (3, 3, camera.K.ravel().tolist()),
        "distortion_coefficients": (1, len(coefficients), coefficients),
    }
    return writers.get(suffix, _yaml)(numbers, matrices)


Matrices = dict[str, tuple[int, int, list[float]]]


def _yaml(numbers: dict[str, int], matrices: Matrices) -> str:
    lines = ["%YAML:1.0", "---"]
    lines += [f"{name}: {value}" for name, value in numbers.items()]
    for name, (rows, columns, data) in matrices.items():
        row = ", ".join(_real(value) for value in data)
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}"]
        lines += ["   dt: d", f"   data: [ {row} ]"]
    return "\n".join(lines) + "\n"


def _xml(numbers: dict[str, int], matrices: Matrices) -> str:
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    lines += [f"<{name}>{value}</{name}>" for name, value in numbers.items()]
    for name, (rows, columns, data) in matrices.items():
        row = " ".join(_real(value) for value in data)
        lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{rows}</rows>"]
        lines += [f"  <cols>{columns}</cols>", "  <dt>d</dt>"]
        lines += [f"  <data>{row}</data></{name}>"]
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _json(numbers: dict[str, int], matrices: Matrices) -> str:
    members: dict[str, Any] = dict(numbers)
    for name, (rows, columns, data) in matrices.items():
        members[name] = {
            **{"type_id": "opencv-matrix", "rows": rows, "cols": columns},
            **{"dt": "d", "data": data},
        }
    return json.dumps(members, indent=4, allow_nan=False) + "\n"


def _real(value: float) -> str:
    """Write a number exactly, with up to 17 digits, and always as a floating-point number."""
    return repr(float(value))


FORMAT = Format(
    name="opencv",
    title="OpenCV's FileStorage (YAML, XML, JSON)",
    recognises=recognises,
    read=read,
    write=write,
    families=ANY_CAMERA,
    file_names=(".yaml", ".yml", ".xml"),
)
