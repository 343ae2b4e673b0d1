"""lensfun's database entries, XML: models poly3, poly5 and ptlens of rectilinear lenses.

Lengths are in millimetres on the sensor: ``cropfactor`` is 43.27 mm over the sensor's diagonal, and
``focal`` the focal length, which PanoTools' models scale by ``1 - a - b - c`` in the picture's
centre, or which ``real-focal`` gives after that scaling. The picture's size is not in the file and
must come from the caller. The lens's centre is the picture's, ``((w - 1) / 2, (h - 1) / 2)``
counted from the centre of the top-left pixel, moved by ``center`` in halves of the shorter side;
these are ``(min(w, h) - 1) / 2`` pixels, as lensfun 0.3 counts them, of a picture of the lens's
``aspect-ratio``. Schema: lensfun's manual, "Lens correction models" and lensfun-database.xsd; the
polynomials are PanoTools', from ideal to observed, of which poly3 is ``b`` alone, and poly5 is
``R_d = R_u (1 + k1 R_u^2 + k2 R_u^4)``.

Written: square pixels with k1 and k2 exactly, as poly5; all else as the nearest ptlens. Read:
poly3 and poly5 exactly, ptlens as the nearest. A lens of several focal lengths has one camera for
each, with the focal length in its name.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from functools import partial

from trisquare.camera.camera import Camera, camera_matrix
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.base import SAY_THE_SIZE, Cameras, Format, ImageSize, only
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import simplest_camera
from trisquare.formats.panotools import PanoFamily, PanoLens
from trisquare.formats.xml_text import number_in, parse_xml

FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)
"""Diagonal of a sensor with a crop factor of 1, millimetres."""

DEFAULT_ASPECT = 1.5
"""Aspect ratio of lenses that do not state it (lensfun's manual)."""

TERMS = {"poly3": ("k1",), "poly5": ("k1", "k2"), "ptlens": ("a", "b", "c")}


def recognises(document: Document) -> bool:
    """Return whether it is XML with lensfun's root element."""
    return document.starts_with("<") and "<lensdatabase" in document.text


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read the lenses of a database, by their names and focal lengths."""
    cameras: dict[str, Callable[[], Lens]] = {}
    # Searched only at their own level: at any depth, nested lenses would take very long.
    for lens in parse_xml(document.text).findall("lens"):
        for distortion in lens.findall("calibration/distortion"):
            name = f"{lens.findtext('model', 'lens')} {distortion.get('focal', '')}".strip()
            if name in cameras:  # of another sensor, or of another maker
                name += f", {lens.findtext('maker', '')} at crop {lens.findtext('cropfactor', '')}"
            while name in cameras:
                name += "'"
            cameras[name] = partial(_lens, lens, distortion, image_size)
    if not cameras:
        raise ValueError("there is no <lens> with a <distortion>")
    return cameras if len(cameras) > 1 else only(next(iter(cameras.values())))


def _lens(
    lens: ElementTree.Element, distortion: ElementTree.Element, image_size: ImageSize | None
) -> Lens:
    if image_size is None:
        raise ValueError(f"lensfun's files do not state the picture's size: {SAY_THE_SIZE}")
    if lens.findtext("type", "rectilinear").strip() != "rectilinear":
        raise ValueError('"type" is not rectilinear: no other type can be read')
    width, height = image_size
    crop = number_in(lens.findtext("cropfactor"), "cropfactor")
    key = "real-focal" if distortion.get("real-focal") is not None else "focal"
    millimetres = number_in(distortion.get(key), key)
    if not (crop > 0 and millimetres > 0):
        raise ValueError(f'"cropfactor" and "{key}" must be positive')
    diagonal = math.hypot(width - 1, height - 1)
    focal = millimetres * crop / FULL_FRAME_DIAGONAL * diagonal
    half = 0.5 * diagonal / math.hypot(1.0, _aspect(lens.findtext("aspect-ratio")))
    moved = lens.find("center")
    x, y = (
        0.5 * (side - 1) + half * number_in("0" if moved is None else moved.get(axis, "0"), axis)
        for side, axis in ((width, "x"), (height, "y"))
    )
    model = distortion.get("model", "")
    if model not in TERMS:
        raise ValueError(f'"model" is {model!r}; of lensfun\'s these are read: {", ".join(TERMS)}')
    terms = {key: number_in(distortion.get(key, "0"), key) for key in TERMS[model]}
    if model == "poly5":
        step = (focal / half) ** 2
        named = {"k1": terms["k1"] * step, "k2": terms["k2"] * step**2}
        return simplest_camera(camera_matrix(focal, focal, x, y), named, image_size)
    a, b, c = terms.get("a", 0.0), terms.get("b", terms.get("k1", 0.0)), terms.get("c", 0.0)
    scale = 1.0 - a - b - c
    if not scale > 0:
        raise ValueError(f"a, b and c (or k1) add up to {1 - scale:g}; the sum must be less than 1")
    pinhole = focal / scale if key == "real-focal" else focal
    return PanoLens(pinhole, a, b, c, half, (x, y), image_size).as_seen("lensfun's ptlens")


def _aspect(text: str | None) -> float:
    """Return the longer side over the shorter one, from ``3:2`` or ``1.5``."""
    if text is None:
        return DEFAULT_ASPECT
    sides = [number_in(part, "aspect-ratio") for part in text.split(":")]
    if len(sides) > 2 or not min(sides) > 0:
        raise ValueError(f'"aspect-ratio" must be written 3:2 or 1.5, not {text!r}')
    ratio = sides[0] / (sides[1] if len(sides) == 2 else 1.0)
    return max(ratio, 1.0 / ratio)


def write(lens: Camera | PanoLens, suffix: str) -> str:
    """Write a database of one lens."""
    width, height = lens.image_size
    diagonal = math.hypot(width - 1, height - 1)
    half = 0.5 * (min(width, height) - 1)
    if half == 0:
        raise ValueError("lensfun has no unit of length for a picture that is one pixel wide")
    if isinstance(lens, Camera):
        step = (half / lens.fx) ** 2
        k1, k2 = lens.distortion[:2].tolist()
        focal, centre = lens.fx, (lens.cx, lens.cy)
        terms = {"k1": k1 * step, "k2": k2 * step**2}
    else:
        focal = lens.focal
        centre = lens.centre
        terms = {"a": lens.a, "b": lens.b, "c": lens.c}
    model = "poly5" if isinstance(lens, Camera) else "ptlens"
    millimetres = focal / diagonal * FULL_FRAME_DIAGONAL
    shift = [(c - 0.5 * (side - 1)) / half for c, side in zip(centre, lens.image_size, strict=True)]
    attributes = " ".join(f'{key}="{float(value)!r}"' for key, value in terms.items())
    return f"""<lensdatabase version="1">
    <mount><name>trisquare</name></mount>
    <lens>
        <maker>trisquare</maker>
        <model>lens</model>
        <mount>trisquare</mount>
        <cropfactor>1.0</cropfactor>
        <aspect-ratio>{max(width, height) - 1}:{min(width, height) - 1}</aspect-ratio>
        <center x="{shift[0]!r}" y="{shift[1]!r}"/>
        <type>rectilinear</type>
        <calibration>
            <distortion model="{model}" focal="{millimetres!r}" {attributes}/>
        </calibration>
    </lens>
</lensdatabase>
"""


FORMAT = Format(
    name="lensfun",
    title="lensfun's XML",
    recognises=recognises,
    read=read,
    write=write,
    families=(
        Family("poly5 (k1, k2 with square pixels)", ("k1", "k2"), square=True),
        PanoFamily("ptlens (a, b, c with square pixels)", border=1),
    ),
    file_names=("lensfun.xml",),
)
