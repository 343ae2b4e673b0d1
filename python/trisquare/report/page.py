"""The page of a report: what was gathered, laid out by the template beside this file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from trisquare.analysis.comparison import two_digits
from trisquare.analysis.diagnosis import diagnose
from trisquare.analysis.residuals import measured_sides
from trisquare.camera.projection_uncertainty import ProjectionMap
from trisquare.images.photographs import Photographs
from trisquare.report import content
from trisquare.report.layers import PictureLayers, picture_layers
from trisquare.report.pictures import ReportedPicture, reported_pictures
from trisquare.report.plot_style import SERIES, inline_svg, plotting
from trisquare.report.plots import residuals_by_radius, residuals_by_side, uncertainty_map
from trisquare.report.scene_sketch import scene_sketch
from trisquare.results.calibration import Calibration

MOST_PICTURES = 6
"""Photographs shown: what is odd is seen in the first, and a page of hundreds would not open."""

MOST_REJECTED = 30
"""Rows on candidates that were not used."""


def page_of(
    calibration: Calibration,
    photographs: Photographs,
    command: str | None,
) -> bytes:
    """Gather, draw and lay out; the arguments are those of `report_page`."""
    pictures: list[ReportedPicture] = []
    layers: list[PictureLayers] = []
    for picture in reported_pictures(calibration, photographs):
        if len(layers) < MOST_PICTURES:
            layers.append(picture_layers(calibration, picture))
        pictures.append(replace(picture, pixels=None))  # which are most of it
    known = calibration.projection_map()
    json = calibration.to_json().encode()
    script = _own("report.js")
    page: str = _template().render(
        calibration=calibration,
        summary=list(content.summary(calibration, known)),
        parameters=list(content.parameter_texts(calibration)),
        meanings=content.MEANINGS,
        diagnosis=diagnose(calibration),
        correlations=content.correlations(calibration),
        settings=content.settings(calibration),
        plane_texts=content.plane_texts,
        pictures=pictures,
        names={picture.index: picture.name for picture in pictures},
        layers=layers,
        most_rejected=MOST_REJECTED,
        series=SERIES,
        has_files=bool(photographs.sources),
        command=command,
        style=Markup(_own("report.css")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
        json="data:application/json;base64," + base64.b64encode(json).decode("ascii"),
        **_plots(calibration, known, pictures, layers),
    )
    # A file's name may hold bytes that are no text.
    return page.encode("utf-8", "backslashreplace")


def _plots(
    calibration: Calibration,
    known: ProjectionMap,
    pictures: Sequence[ReportedPicture],
    layers: Sequence[PictureLayers],
) -> dict[str, Any]:
    """Draw the plots: those that cannot be drawn are None."""
    sides = [side for picture in pictures for side in measured_sides(calibration, picture.index)]
    with plotting():
        uncertainty = uncertainty_map(calibration, known)
        by_radius, beyond_scale = residuals_by_radius(calibration, sides) or (None, 0)
        return {
            "by_side": _svg(residuals_by_side(sides) if sides else None, "by-side"),
            "by_radius": _svg(by_radius, "by-radius"),
            "beyond_scale": beyond_scale,
            "uncertainty": _svg(uncertainty, "uncertainty"),
            "sketches": [
                _svg(scene_sketch(calibration, layer.index), f"sketch-{layer.index}")
                for layer in layers
            ],
        }


def _svg(figure: Any, name: str) -> Markup | None:
    return None if figure is None else Markup(inline_svg(figure, name))


def _template() -> Any:
    environment = Environment(
        loader=PackageLoader("trisquare.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["two_digits"] = two_digits
    return environment.get_template("report.html.j2")


def _own(name: str) -> str:
    """Return the text of a file beside this one."""
    return (resources.files("trisquare.report") / name).read_text("utf-8").strip()
