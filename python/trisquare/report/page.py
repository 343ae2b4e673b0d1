"""The page of a report, laid out by the template beside this file."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Sequence
from importlib import resources
from typing import Any

from markupsafe import Markup

from trisquare._support.html_pages import page_environment
from trisquare._support.paths import read_bytes
from trisquare.analysis.comparison import two_digits
from trisquare.analysis.diagnosis import diagnose
from trisquare.analysis.residuals import MeasuredSide, measured_sides
from trisquare.camera.lens_models import is_fisheye
from trisquare.camera.projection_uncertainty import ProjectionMap
from trisquare.images.exif import StatedFocalLength, stated_focal_length
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import picture_size
from trisquare.report import content
from trisquare.report.layers import PictureLayers, picture_layers
from trisquare.report.lens import lens_equations, valid_radius_text
from trisquare.report.pictures import shown_pixels
from trisquare.report.plot_style import SERIES, inline_svg, plotting
from trisquare.report.plots import (
    displacement_by_radius,
    residuals_by_radius,
    residuals_by_side,
    uncertainty_map,
)
from trisquare.report.scene import scene_of
from trisquare.results.calibration import Calibration

MAX_PICTURES = 6
"""Maximum number of photographs shown: anomalies show in the first ones, and a page of hundreds
would not open."""

DIGEST_LETTERS = 16
"""Number of letters of a file's SHA-256 that are shown: enough to distinguish photographs."""

MAX_OPEN = 3
"""Number of photographs up to which all are unfolded; of more, only the first is."""

MAX_REJECTED = 30
"""Maximum number of rows on rejected candidates."""


def page_of(
    calibration: Calibration,
    photographs: Photographs,
    command: str | None,
) -> bytes:
    """Return the page in UTF-8; the arguments are those of `report_page`."""
    names, files, layers, lengths = _pictures(calibration, photographs)
    sides = [side for index in names for side in measured_sides(calibration, index)]
    known = calibration.projection_map()
    json = calibration.to_json().encode()
    script = _own("report.js")
    environment = page_environment("trisquare.report")
    environment.filters["two_digits"] = two_digits
    parameters = list(content.parameter_texts(calibration))
    page: str = environment.get_template("report.html.j2").render(
        calibration=calibration,
        summary=list(content.summary(calibration, known)),
        parameters=parameters,
        equations=lens_equations(calibration.camera, {name for name, *_ in parameters}),
        is_fisheye=is_fisheye(calibration.camera.model),
        valid_radius=valid_radius_text(calibration.camera),
        focal_lengths=lengths,
        meanings=content.meanings(calibration.camera),
        diagnosis=diagnose(calibration),
        settings=content.settings(calibration),
        plane_texts=content.plane_texts,
        angles=content.angles_between_planes(calibration),
        distance_unit=content.distance_unit(calibration.planes),
        names=names,
        files=files,
        pictures=layers,
        most_rejected=MAX_REJECTED,
        most_open=MAX_OPEN,
        copied=content.copied(calibration.camera),
        series=SERIES,
        command=command,
        style=Markup(_own("report.css")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
        json="data:application/json;base64," + base64.b64encode(json).decode("ascii"),
        scene=scene_of(calibration),
        **_plots(calibration, known, sides),
    )
    # A file's name may contain bytes that are not text.
    return page.encode("utf-8", "backslashreplace")


def _pictures(
    calibration: Calibration, photographs: Photographs
) -> tuple[dict[int, str], list[tuple[str, str]], list[PictureLayers], list[str]]:
    """Return names, files with digests, layers of the first pictures, and focal lengths in mm."""
    names: dict[int, str] = {}
    files: list[tuple[str, str]] = []
    layers: list[PictureLayers] = []
    stated: list[StatedFocalLength] = []
    if not photographs.sources:
        indices = sorted({plane.image for plane in calibration.planes} or {0})
        names = {index: f"picture {index}" for index in indices}
        layers = [picture_layers(calibration, index, None) for index in indices[:MAX_PICTURES]]
    for photograph in photographs:
        index, path, pixels = photograph.index, photograph.path, photograph.pixels
        size, camera_size = picture_size(pixels), calibration.camera.image_size
        if size != camera_size:
            raise ValueError(
                f"picture {index} is {size[0]} x {size[1]}, the calibration's are "
                f"{camera_size[0]} x {camera_size[1]}: is it one of them?"
            )
        names[index] = f"picture {index}" if path is None else os.path.basename(path)
        if path is None or not os.path.isfile(path):  # a pipe can be read only once
            files.append((names[index], "no file"))
        else:
            encoded = read_bytes(path)
            files.append((names[index], _digest(encoded)))
            stated += filter(None, [stated_focal_length(encoded, size)])
        if len(layers) < MAX_PICTURES:
            shown = shown_pixels(pixels, linear=calibration.tone == "linear")
            layers.append(picture_layers(calibration, index, shown))
    lengths = [content.focal_length_text(calibration, each) for each in dict.fromkeys(stated)]
    return names, files, layers, lengths


def _plots(
    calibration: Calibration,
    known: ProjectionMap,
    sides: Sequence[MeasuredSide],
) -> dict[str, Any]:
    """Return the plots; those that cannot be drawn are None."""
    with plotting():
        uncertainty = uncertainty_map(calibration, known)
        by_radius, beyond_scale = residuals_by_radius(calibration, sides) or (None, 0)
        return {
            "displacement": _svg(displacement_by_radius(calibration.camera, sides), "displacement"),
            "by_side": _svg(residuals_by_side(sides) if sides else None, "by-side"),
            "by_radius": _svg(by_radius, "by-radius"),
            "beyond_scale": beyond_scale,
            "uncertainty": _svg(uncertainty, "uncertainty"),
        }


def _svg(figure: Any, name: str) -> Markup | None:
    return None if figure is None else Markup(inline_svg(figure, name))


def _digest(encoded: bytes) -> str:
    """Return a text that identifies a file's content."""
    return f"SHA-256 {hashlib.sha256(encoded).hexdigest()[:DIGEST_LETTERS]}\u2026"


def _own(name: str) -> str:
    """Return the text of a file beside this one."""
    return (resources.files("trisquare.report") / name).read_text("utf-8").strip()
