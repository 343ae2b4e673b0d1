"""Hugin's and PanoTools' project, ``.pto``.

Pixels; the lens's centre is ``d`` and ``e`` pixels right of and below the picture's, which is
``((w - 1) / 2, (h - 1) / 2)`` counted from the centre of the top-left pixel. Schema: PanoTools wiki
"PTO file", lines ``i``: ``w``, ``h``, ``f0`` (rectilinear), ``v`` (the angle of view across the
width, degrees, of the picture without distortion), ``a``, ``b``, ``c``, ``d``, ``e``; ``=n`` means
the value of image n.

Written: square pixels with k1 alone exactly; any other camera as the nearest a, b, c. Read: b
alone exactly; a and c as the nearest. Cameras have the numbers of their images as names, ``"0"``,
``"1"``, unless all have the same lens.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import partial

from trisquare._support.arrays import real_number, size_of_image
from trisquare.formats.approximation import Lens
from trisquare.formats.base import Cameras, Format, ImageSize, only
from trisquare.formats.document import Document
from trisquare.formats.panotools import PanoFamily, PanoLens

WORD = re.compile(r'(?:"[^"]*"|[^\s"])+')
# Variables with a name of one small letter; longer names begin with a capital.
LENS_VARIABLES = ("w", "h", "f", "v", "a", "b", "c", "d", "e", "g", "t")
# Values of variables that newer lines may omit.
DEFAULTS = dict.fromkeys(("a", "b", "c", "d", "e", "g", "t"), "0")

Variables = Mapping[str, str]


def recognises(document: Document) -> bool:
    """Return whether there is a line of a panorama and one of an image."""
    return all(
        re.search(rf"^{letter} .*\b[fw]\d", document.text, re.MULTILINE) for letter in ("p", "i")
    )


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the lenses of a project's images."""
    images: list[Variables] = [
        {word[0]: word[1:] for word in WORD.findall(line[2:]) if word[0] in LENS_VARIABLES}
        for line in document.text.splitlines()
        if line.startswith("i ")
    ]
    if not images:
        raise ValueError('there is no line "i", which states the lens of an image')
    cameras = {str(i): partial(_lens, images, i) for i in range(len(images))}
    resolved = [
        {key: _resolved(images, i, key) for key in LENS_VARIABLES} for i in range(len(images))
    ]
    return cameras if any(lens != resolved[0] for lens in resolved) else only(cameras["0"])


def _resolved(images: Sequence[Variables], index: int, key: str) -> str | None:
    """Return the value of a variable, or that of the image that it is linked to."""
    value = images[index].get(key, DEFAULTS.get(key))
    if value is None or not value.startswith("="):
        return value
    linked = int(value[1:]) if re.fullmatch(r"=\d{1,6}", value) else len(images)
    found = images[linked].get(key) if linked < len(images) else None
    if found is None or found.startswith("="):
        raise ValueError(f'"{key}" of image {index} is linked to {value!r}, which has no number')
    return found


def _lens(images: Sequence[Variables], index: int) -> Lens:
    values: dict[str, float] = {}
    for key in LENS_VARIABLES:
        text = _resolved(images, index, key)
        if text is None:
            raise ValueError(f'"{key}" of image {index} is missing')
        try:
            values[key] = real_number(float(text), key)
        except ValueError as error:
            raise ValueError(f'"{key}" of image {index} must be a number, not {text!r}') from error
    if values["f"] != 0:
        raise ValueError(f'"f" of image {index} is {values["f"]:g}: only f0, rectilinear, is read')
    if values["g"] or values["t"]:
        raise ValueError(f'"g" and "t" of image {index} shear the picture: no camera does')
    if not 0 < values["v"] < 180:
        raise ValueError(f'"v" of image {index} must be from 0 to 180, not {values["v"]:g}')
    if not (values["w"].is_integer() and values["h"].is_integer()):
        raise ValueError(f'"w" and "h" of image {index} must be whole numbers')
    width, height = size = size_of_image((int(values["w"]), int(values["h"])))
    lens = PanoLens(
        focal=0.5 * width / math.tan(0.5 * math.radians(values["v"])),
        a=values["a"],
        b=values["b"],
        c=values["c"],
        half=0.5 * min(size),
        centre=(0.5 * (width - 1) + values["d"], 0.5 * (height - 1) + values["e"]),
        image_size=size,
    )
    return lens.as_seen("Hugin's a, b, c")


def write(lens: PanoLens, suffix: str) -> str:
    """Write a project of one image."""
    width, height = lens.image_size
    view = math.degrees(2.0 * math.atan(0.5 * width / lens.focal))
    shift = (lens.centre[0] - 0.5 * (width - 1), lens.centre[1] - 0.5 * (height - 1))
    numbers = {"a": lens.a, "b": lens.b, "c": lens.c, "d": shift[0], "e": shift[1]}
    words = " ".join(f"{key}{float(value)!r}" for key, value in numbers.items())
    return (
        "# hugin project file\n"
        f'p f0 w{width} h{height} v{math.ceil(min(view, 179.0))} n"TIFF_m"\n'
        "m i0\n"
        f"i w{width} h{height} f0 v{view!r} {words} g0 t0 r0 p0 y0 TrX0 TrY0 TrZ0 "
        'n"photo.jpg"\n'
    )


FORMAT = Format(
    name="hugin",
    title="Hugin's .pto",
    recognises=recognises,
    read=read,
    write=write,
    families=(PanoFamily("a, b, c with square pixels"),),
    file_names=(".pto",),
)
