"""The page of a report: what was gathered, laid out by the template beside this file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from trisquare.analysis.comparison import two_digits
from trisquare.analysis.residuals import MeasuredSide
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
        pictures.append(picture.without_pixels())
    sides = [side for picture in pictures for side in picture.sides]
    known = calibration.projection_map()
    names = [picture.name for picture in pictures]
    json = calibration.to_json().encode()
    script = _own("report.js")
    page: str = _template().render(
        title=_title(names),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
        style=Markup(_own("report.css")),
        series=range(SERIES),
        summary=list(content.summary(calibration, known)),
        warnings=calibration.warnings,
        rejected=content.rejected_rows(calibration, names),
        more_rejected=max(0, len(calibration.rejected) - content.MOST_REJECTED),
        parameters=content.parameter_rows(calibration),
        free=calibration.parameters,
        correlations=content.correlations(calibration),
        planes=content.plane_rows(calibration, names),
        pictures=layers,
        more_pictures=len(pictures) - len(layers),
        settings=content.settings(calibration),
        files=content.picture_rows(pictures) if photographs.sources else [],
        command=command,
        json="data:application/json;base64," + base64.b64encode(json).decode("ascii"),
        **_plots(calibration, known, sides, [layer.index for layer in layers]),
    )
    # A file's name may hold bytes that are no text.
    return page.encode("utf-8", "backslashreplace")


def _plots(
    calibration: Calibration,
    known: ProjectionMap,
    sides: Sequence[MeasuredSide],
    indices: Sequence[int],
) -> dict[str, Any]:
    """Draw the plots: those that cannot be drawn are None."""
    with plotting():
        uncertainty = uncertainty_map(calibration, known)
        by_radius = residuals_by_radius(calibration, sides)
        sketches = {index: scene_sketch(calibration, index) for index in indices}
        return {
            "by_side": _svg(residuals_by_side(sides) if sides else None, "by-side"),
            "by_radius": _svg(None if by_radius is None else by_radius[0], "by-radius"),
            "beyond_scale": 0 if by_radius is None else by_radius[1],
            "uncertainty": _svg(uncertainty, "uncertainty"),
            "sketches": {
                index: _svg(figure, f"sketch-{index}") for index, figure in sketches.items()
            },
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


def _title(names: Sequence[str]) -> str:
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return f"Calibration from {names[0]}{others}"
