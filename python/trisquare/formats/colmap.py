"""COLMAP's ``cameras.txt``.

Pixels, with ``(0, 0)`` at the top-left **corner** of the top-left one, so that a principal point is
half a pixel larger than trisquare's in each coordinate. Schema: COLMAP's documentation, "Output
format": lines of ``CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]``, the parameters in the order of
src/colmap/sensor/models.h.

Written and read: the simplest of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and
FULL_OPENCV that has the camera's coefficients, or of the fisheyes SIMPLE_RADIAL_FISHEYE,
RADIAL_FISHEYE and OPENCV_FISHEYE. The last of each can write every such camera, FULL_OPENCV
rational lenses as well; thin prisms cannot be written. THIN_PRISM_FISHEYE is read if its tangential
and prism terms are zero.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial

from trisquare._support.arrays import real_number
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.camera.lens_models import FISHEYE, RATIONAL
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.base import Cameras, Format, ImageSize
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import fisheye_of, opencv_lens, simplest_camera

HALF_PIXEL = 0.5
"""Offset from trisquare's pixel coordinates to COLMAP's."""

FOCALS_AND_COEFFICIENTS = {
    "SIMPLE_PINHOLE": (1, 0),
    "PINHOLE": (2, 0),
    "SIMPLE_RADIAL": (1, 1),
    "RADIAL": (1, 2),
    "OPENCV": (2, 4),
    "FULL_OPENCV": (2, 8),
    "OPENCV_FISHEYE": (2, 4),
    "SIMPLE_RADIAL_FISHEYE": (1, 1),
    "RADIAL_FISHEYE": (1, 2),
    "THIN_PRISM_FISHEYE": (2, 8),
}
"""Numbers of focal lengths, one or two, and of coefficients of each model."""

FAMILIES = (
    Family("FULL_OPENCV", RATIONAL, all_coefficients=RATIONAL),
    Family("SIMPLE_RADIAL_FISHEYE", ("k1",), square=True, all_coefficients=FISHEYE),
    Family("RADIAL_FISHEYE", ("k1", "k2"), square=True, all_coefficients=FISHEYE),
    Family("OPENCV_FISHEYE", FISHEYE, all_coefficients=FISHEYE),
    Family("SIMPLE_PINHOLE", (), square=True),
    Family("PINHOLE", ()),
    Family("SIMPLE_RADIAL", ("k1",), square=True),
    Family("RADIAL", ("k1", "k2"), square=True),
    Family("OPENCV", ("k1", "k2", "p1", "p2")),
    Family("FULL_OPENCV", ("k1", "k2", "p1", "p2", "k3")),
)

LINE = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"
# Spaces and tabs only: \s would match line ends, and take quadratic time on a file of empty lines.
CAMERA_LINE = re.compile(
    r"^[ \t]*\d+[ \t]+[A-Z][A-Z_]+[ \t]+\d+[ \t]+\d+([ \t]+\S+)+[ \t\r]*$", re.MULTILINE
)


def recognises(document: Document) -> bool:
    """Return whether a line has an id, a model in capitals, a size, and parameters."""
    return CAMERA_LINE.search(document.text[:65536]) is not None


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the cameras of a file, by their ids."""
    lines = [line.split() for line in document.text.splitlines()]
    cameras = {
        words[0]: partial(_camera, words)
        for words in lines
        if words and not words[0].startswith("#")
    }
    if not any(number.isdigit() for number in cameras):
        raise ValueError(f"no line is a camera of COLMAP's, {LINE}")
    return cameras


def _camera(words: Sequence[str]) -> Lens:
    where = f"camera {words[0]}"
    if len(words) < 4:
        raise ValueError(f"{where}: its line must be {LINE}")
    model = words[1]
    if model not in FOCALS_AND_COEFFICIENTS:
        raise ValueError(
            f"{where}: the model {model!r} cannot be read; of COLMAP's these can: "
            f"{', '.join(FOCALS_AND_COEFFICIENTS)}"
        )
    size = (_integer(words[2], f"{where}: WIDTH"), _integer(words[3], f"{where}: HEIGHT"))
    focals, coefficients = FOCALS_AND_COEFFICIENTS[model]
    if len(words) - 4 != focals + 2 + coefficients:
        raise ValueError(
            f"{where}: {model} has {focals + 2 + coefficients} parameters, not {len(words) - 4}"
        )
    numbers = [_real(word, f"{where}: PARAMS[{i}]") for i, word in enumerate(words[4:])]
    cx, cy = (number - HALF_PIXEL for number in numbers[focals : focals + 2])
    K = camera_matrix(numbers[0], numbers[focals - 1], cx, cy)
    distortion = numbers[focals + 2 :]
    if model == "THIN_PRISM_FISHEYE":
        k1, k2, p1, p2, k3, k4, sx1, sy1 = distortion
        if any((p1, p2, sx1, sy1)):
            raise ValueError(
                f"{where}: {model} is read without tangential and prism terms only, "
                f"not with p1 {p1:g}, p2 {p2:g}, sx1 {sx1:g}, sy1 {sy1:g}"
            )
        distortion = [k1, k2, k3, k4]
    if model.endswith("FISHEYE"):
        return fisheye_of(K, distortion, size)
    if model in ("SIMPLE_RADIAL", "RADIAL"):
        named = dict(zip(("k1", "k2"), distortion, strict=False))
        return simplest_camera(K, named, size)
    return opencv_lens(K, distortion, size)


def _integer(word: str, name: str) -> int:
    if not re.fullmatch(r"\d{1,10}", word):
        raise ValueError(f"{name} must be a whole number, not {word!r}")
    return int(word)


def _real(word: str, name: str) -> float:
    try:
        return real_number(float(word), name)
    except ValueError as error:
        raise ValueError(f"{name} must be a finite number, not {word!r}") from error


def write(camera: Camera, suffix: str) -> str:
    """Write a file of one camera, with id 1."""
    family = next(family for family in FAMILIES if family.exactly(camera) is not None)
    in_order = (*camera.distortion.tolist(), *(0.0, 0.0, 0.0))
    coefficients = in_order[: FOCALS_AND_COEFFICIENTS[family.title][1]]
    numbers = [camera.fx] if family.square else [camera.fx, camera.fy]
    numbers += [camera.cx + HALF_PIXEL, camera.cy + HALF_PIXEL, *coefficients]
    width, height = camera.image_size
    return (
        "# Camera list with one line of data per camera:\n"
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        "# Number of cameras: 1\n"
        f"1 {family.title} {width} {height} {' '.join(repr(float(value)) for value in numbers)}\n"
    )


FORMAT = Format(
    name="colmap",
    title="COLMAP's cameras.txt",
    recognises=recognises,
    read=read,
    write=write,
    families=FAMILIES,
    file_names=("cameras.txt", ".txt"),
)
