"""Agisoft's calibration XML, of Metashape and of PhotoScan since 1.2.

Pixels; ``cx`` and ``cy`` count from the middle of the picture, which is
``((w - 1) / 2, (h - 1) / 2)`` counted from the centre of the top-left pixel. Schema: Metashape's
manual, appendix "Camera models": ``projection``, ``width``, ``height``, ``f``, ``cx``, ``cy``,
``b1``, ``b2``, ``k1`` to ``k4``, ``p1`` to ``p4``; missing ones are 0. ``f`` is fy, ``b1`` is
fx - fy and ``b2`` the skew; k1 to k3 are OpenCV's, and ``p1`` and ``p2`` are OpenCV's p2 and p1. A
fisheye's polynomial is that of the angle, with k1 to k4, as in OpenCV.

*File > Export > Export Cameras* writes a ``<document>`` with the calibrations of all sensors: the
same numbers, ``width`` and ``height`` as attributes of ``resolution``, the projection as ``type``.
Those with the ``class`` ``adjusted`` are read, named by their sensors' labels.

Written: ``frame`` with k1 to k3, p1 and p2, and ``fisheye`` with k1 to k4. Read: these; a frame
with k4 as the nearest. Not read: other projections, p3 and p4, and a fisheye with p1 or p2.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from trisquare._support.arrays import size_of_image
from trisquare.camera.camera import Camera, camera_matrix, camera_parameters
from trisquare.camera.lens_models import is_fisheye
from trisquare.formats.approximation import ANY_BROWN, ANY_FISHEYE, Lens
from trisquare.formats.base import Cameras, Format, ImageSize, only
from trisquare.formats.document import Document
from trisquare.formats.other_lenses import ForeignLens, fisheye_of, simplest_camera
from trisquare.formats.xml_text import number_in, parse_xml

RADIAL = ("k1", "k2", "k3", "k4")
OPTIONAL = ("cx", "cy", "b1", "b2", *RADIAL, "p1", "p2", "p3", "p4")


def recognises(document: Document) -> bool:
    """Return whether it is XML with a calibration of a projection, or a chunk of cameras."""
    start = document.text[:4096]
    return document.starts_with("<") and (
        ("<calibration" in start and "<projection" in start)
        or ("<document" in start and "<chunk" in start)
    )


def read(document: Document, image_size: ImageSize | None) -> Cameras:
    """Read one camera, or those of all sensors."""
    if "<document" not in document.text[:4096]:
        return only(lambda: _camera(_texts(parse_xml(document.text))))
    sensors = list(parse_xml(document.text).iter("sensor"))
    if not sensors:
        raise ValueError(
            "no sensor: export the cameras, File > Export > Export Cameras, or save one "
            "calibration, Tools > Camera Calibration > Save"
        )
    labels = [sensor.get("label", "") for sensor in sensors]
    names = labels if len({*labels}) == len(labels) else [f"sensor {i}" for i in range(len(labels))]
    return {
        name: partial(_camera_of_sensor, sensor)
        for name, sensor in zip(names, sensors, strict=True)
    }


def _camera_of_sensor(sensor: ElementTree.Element) -> Lens:
    calibration = sensor.find("calibration[@class='adjusted']")
    if calibration is None:
        raise ValueError(
            f"the sensor {sensor.get('label', '')!r} has no adjusted calibration: align its "
            "photographs first"
        )
    texts = _texts(calibration)
    resolution = calibration.find("resolution")
    if resolution is not None:
        texts |= resolution.attrib
    return _camera({**texts, "projection": calibration.get("type", "")})


def _texts(calibration: ElementTree.Element) -> dict[str, str]:
    """Return the texts of the elements by name; of several with one name, that of the first."""
    return {child.tag: child.text or "" for child in reversed(calibration)}


def _camera(texts: Mapping[str, str]) -> Lens:
    projection = texts.get("projection", "").strip()
    if projection not in ("frame", "fisheye"):
        raise ValueError(
            f'"projection" is {projection!r}; of Metashape\'s these are read: frame, fisheye'
        )
    if "f" not in texts and "fx" in texts:
        raise ValueError('"f" is missing: files of PhotoScan before 1.2, with "fx", are not read')
    width, height, f = (number_in(texts.get(key), key) for key in ("width", "height", "f"))
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f'"width" and "height" must be whole numbers, not {width:g}, {height:g}')
    size = size_of_image((int(width), int(height)))
    values = {key: number_in(texts.get(key, "0"), key) for key in OPTIONAL}
    cx, cy = values["cx"] + 0.5 * (width - 1), values["cy"] + 0.5 * (height - 1)
    K = camera_matrix(f + values["b1"], f, cx, cy, values["b2"])
    unread = ("p3", "p4") if projection == "frame" else ("p1", "p2", "p3", "p4")
    for key in unread:
        if values[key]:
            raise ValueError(f'"{key}" is {values[key]:g}; of a {projection} it must be 0')
    if projection == "fisheye":
        return fisheye_of(K, [values[key] for key in RADIAL], size)
    # p1 and p2 are interchanged in Metashape.
    named = {key: values[key] for key in RADIAL} | {"p1": values["p2"], "p2": values["p1"]}
    if not values["k4"]:
        return simplest_camera(K, named, size)
    if values["b2"]:
        raise ValueError('"k4" and "b2" are not read together: one of them must be 0')
    return ForeignLens("Metashape's frame with k4", K, size, " ".join(named), list(named.values()))


def write(camera: Camera, suffix: str) -> str:
    """Write a calibration."""
    width, height = camera.image_size
    numbers = camera_parameters(camera)
    # p1 and p2 are interchanged in Metashape.
    named = {key: numbers.get(key, 0.0) for key in RADIAL} | {
        "p1": numbers.get("p2", 0.0),
        "p2": numbers.get("p1", 0.0),
    }
    values = {
        "f": camera.fy,
        "cx": camera.cx - 0.5 * (width - 1),
        "cy": camera.cy - 0.5 * (height - 1),
        "b1": camera.fx - camera.fy,
        "b2": camera.skew,
        **named,
    }
    members = {
        "projection": "fisheye" if is_fisheye(camera.model) else "frame",
        "width": width,
        "height": height,
        **{key: repr(float(value)) for key, value in values.items()},
    }
    lines = [f"  <{key}>{value}</{key}>" for key, value in members.items()]
    start = '<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n'
    return start + "\n".join(lines) + "\n</calibration>\n"


FORMAT = Format(
    name="metashape",
    title="Metashape's calibration XML",
    recognises=recognises,
    read=read,
    write=write,
    families=(replace(ANY_FISHEYE, skewed=True), replace(ANY_BROWN, skewed=True)),
    file_names=("metashape.xml",),
)
