"""mrcal's ``.cameramodel``.

Pixels, with ``(0, 0)`` at the centre of the top-left one. Schema: mrcal's documentation, "The
.cameramodel file format": a Python dictionary of ``lensmodel``, ``intrinsics`` [fx, fy, cx, cy,
distortion ...], ``imagersize`` [width, height] and ``extrinsics``, a Rodrigues rotation and a
translation from the reference, which are written as zeros and not read.

Written and read: the simplest of LENSMODEL_PINHOLE, LENSMODEL_OPENCV4 (k1, k2, p1, p2),
LENSMODEL_OPENCV5 (and k3), LENSMODEL_OPENCV8 (and k4, k5, k6) and LENSMODEL_OPENCV12 (and s1 to s4)
that has the camera's coefficients; fisheyes cannot be written.
"""

from __future__ import annotations

import re

from trisquare._support.json_members import JsonFields, parse_json
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.camera.lens_models import RATIONAL, THIN_PRISM
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.base import Cameras, Format, ImageSize, only, size_member
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import opencv_lens

COEFFICIENTS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}

FAMILIES = (
    Family("LENSMODEL_OPENCV8", RATIONAL, all_coefficients=RATIONAL),
    Family("LENSMODEL_OPENCV12", THIN_PRISM, all_coefficients=THIN_PRISM),
    Family("LENSMODEL_PINHOLE", ()),
    Family("LENSMODEL_OPENCV4", ("k1", "k2", "p1", "p2")),
    Family("LENSMODEL_OPENCV5", ("k1", "k2", "p1", "p2", "k3")),
)

# Tokens of Python literals that JSON does not have: other strings, comments, trailing commas,
# numbers such as 1. and .5.
# Strings come first, so that their contents are left alone. A number must not follow a digit: a
# match attempted from each digit of a long number would take quadratic time.
PYTHON_TOKENS = re.compile(
    r"""b?'(?P<single>[^'"\\\n]*)'|b?"(?P<double>[^"\\\n]*)"|(?P<comment>\#[^\n]*)"""
    r"""|(?P<comma>,(?=(?:\s|\#[^\n]*(?:\n|$))*[\]})]))|(?P<open>\()|(?P<close>\))"""
    r"""|(?P<number>(?<![\d.])[-+]?(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][-+]?\d+)?)""",
)


def recognises(document: Document) -> bool:
    """Return whether it has a lensmodel in quotes."""
    return re.search(r"""['"]lensmodel['"]\s*:""", document.text) is not None


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read a camera model."""
    return only(lambda: _camera(_parse(document.text)))


def _parse(text: str) -> JsonFields:
    """Read a Python dictionary of strings and numbers without Python's parser."""

    def as_json(token: re.Match[str]) -> str:
        if token["comment"] is not None or token["comma"] is not None:
            return " "
        if token["open"] or token["close"]:
            return "[" if token["open"] else "]"
        if token["number"] is not None:
            return repr(float(token["number"]))
        return '"' + (token["single"] or token["double"] or "") + '"'

    try:
        return JsonFields(parse_json(PYTHON_TOKENS.sub(as_json, text)))
    except ValueError as error:
        raise ValueError(f"not a dictionary of names and numbers: {error}") from error


def _camera(members: JsonFields) -> Lens:
    model = members.text("lensmodel")
    if model not in COEFFICIENTS:
        raise ValueError(
            f'"lensmodel" is {model!r}; of mrcal\'s these can be read: {", ".join(COEFFICIENTS)}'
        )
    fx, fy, cx, cy, *distortion = members.array("intrinsics", (4 + COEFFICIENTS[model],)).tolist()
    return opencv_lens(
        camera_matrix(fx, fy, cx, cy), distortion, size_member(members, "imagersize")
    )


def write(camera: Camera, suffix: str) -> str:
    """Write a camera model whose pose is that of the reference."""
    family = next(family for family in FAMILIES if family.exactly(camera) is not None)
    count = COEFFICIENTS[family.title]
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion.tolist()[:count]]
    return (
        "{\n"
        f"    'lensmodel':  '{family.title}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {', '.join(repr(float(value)) for value in numbers)},],\n\n"
        "    # extrinsics are rt_fromref\n"
        "    'extrinsics': [ 0, 0, 0, 0, 0, 0,],\n\n"
        f"    'imagersize': [ {camera.image_size[0]}, {camera.image_size[1]},],\n"
        "}\n"
    )


FORMAT = Format(
    name="mrcal",
    title="mrcal's .cameramodel",
    recognises=recognises,
    read=read,
    write=write,
    families=FAMILIES,
    file_names=(".cameramodel",),
)
