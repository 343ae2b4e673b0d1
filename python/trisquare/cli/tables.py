"""A calibration as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType
from rich.text import Text

from trisquare._support.number_text import decimals_shown, with_its_std
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.cli.console import line_of, new_table
from trisquare.cli.options import as_options
from trisquare.report.content import (
    distance_unit,
    held_text,
    parameter_texts,
    plane_texts,
    unit_of,
)
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.model_alternative import evidence_text
from trisquare.results.rejected import Rejected, is_reported

MAX_REJECTED = 10
"""Maximum number of lines on rejected candidates, so that the results remain prominent."""


MAX_WARNINGS = 5
"""Maximum number of warnings shown by default, so that they are read."""


def calibration_report(
    calibration: Calibration, missed: Sequence[Rejected] = ()
) -> list[RenderableType]:
    """Return the parameters, the planes, and what was not used, including squares `missed`."""
    parameters = new_table("parameter", "unit", right=("value", "std"))
    for row in parameter_texts(calibration):
        parameters.add_row(*row)
    unit = distance_unit(calibration.planes)
    planes = new_table(
        "plane", "kind", right=("picture", f"distance {unit}", "tilt deg", "rms px", "samples")
    )
    for number, plane in enumerate(calibration.planes):
        texts = plane_texts(plane, unit)
        called = str(number) if plane.is_used else f"{number} unused"
        planes.add_row(called, line_of(plane.kind), str(plane.image), *texts)
    details = [
        *_pictures(calibration),
        *_unused(calibration),
        *_aspects(calibration),
        *_lines(calibration),
        *_rejected(calibration, missed),
    ]
    return [parameters, planes, _summary(calibration), *details]


def _pictures(calibration: Calibration) -> list[Text]:
    """Return a line with the files of several pictures: long names do not fit into a column."""
    names = calibration.pictures
    if not names:
        return []
    listed = ", ".join(f"{index} {name}" for index, name in enumerate(names) if name)
    return [line_of(f"pictures: {listed}")]


def _picture(calibration: Calibration, index: int) -> str:
    """Return a picture's index and, if there are several, its file's name."""
    names = calibration.pictures
    return f"{index} ({names[index]})" if names and names[index] else str(index)


def comparison_report(calibration: Calibration, truth: Camera) -> list[RenderableType]:
    """Return a table of the estimate and the truth."""
    numbers = ("estimate", "std", "truth", "error", "error/std")
    table = new_table("parameter", "unit", right=numbers)
    true_values = camera_parameters(truth)
    for name, value in camera_parameters(calibration.camera).items():
        if name in calibration.std:
            std, true_value = calibration.std[name], true_values[name]
            error, decimals = value - true_value, decimals_shown(std)
            table.add_row(
                name,
                unit_of(name),
                *with_its_std(value, std),
                f"{true_value:.{decimals}f}",
                f"{error:+.{decimals}f}",
                f"{error / std:+.1f}" if std > 0 else "",
            )
    return [table, _summary(calibration)]


def _summary(calibration: Calibration) -> Text:
    width, height = calibration.camera.image_size
    evidence = evidence_text(calibration.alternatives)
    chosen = f", {evidence}" if evidence else ""
    held = held_text(calibration)
    held = f", fixed: {held}" if held else ""
    return line_of(
        f"{width} x {height}, model {calibration.camera.model}{chosen}, "
        f"method {calibration.method} ({calibration.stage}){held}: rms {calibration.rms:.4f} px, "
        f"noise scale {calibration.noise_scale:.2f}"
    )


def _unused(calibration: Calibration) -> list[Text]:
    """Return a line for each plane that is not used."""
    planes = enumerate(calibration.planes)
    return [
        line_of(as_options(f"plane {number} is not used: {plane.rejection}"))
        for number, plane in planes
        if not plane.is_used
    ]


def _aspects(calibration: Calibration) -> list[Text]:
    """Return a line for each rectangle whose aspect was estimated."""
    lines = []
    for number, plane in enumerate(calibration.planes):
        if plane.aspect is not None and plane.aspect_std is not None:
            value, std = with_its_std(plane.aspect, plane.aspect_std)
            lines.append(line_of(f"plane {number}: aspect {value}, std {std}"))
    return lines


def _lines(calibration: Calibration) -> list[Text]:
    """Return a line with the number of used lines of the scene, if there are any."""
    if not calibration.lines:
        return []
    used = sum(line.is_used for line in calibration.lines)
    return [line_of(f"{used} of {len(calibration.lines)} lines of the scene used")]


def _rejected(calibration: Calibration, missed: Sequence[Rejected]) -> list[Text]:
    """Return a line for each of the first rejected candidates that no warning mentions."""
    lines = []
    unreported = [
        candidate
        for candidate in (*calibration.rejected, *missed)
        if not any(is_reported(warning, [candidate]) for warning in calibration.warnings)
    ]
    for candidate in unreported[:MAX_REJECTED]:
        x, y = candidate.corners.mean(axis=0).tolist()
        residual = "" if candidate.residual is None else f", {candidate.residual:.3g} px"
        place = f"({x:.0f}, {y:.0f}) of picture {_picture(calibration, candidate.image)}"
        lines.append(f"not used: {candidate.kind} around {place}: {candidate.reason}{residual}")
    if len(unreported) > MAX_REJECTED:
        lines.append(f"not used: {len(unreported) - MAX_REJECTED} more")
    return [line_of(as_options(line), "dim") for line in lines]


def warning_lines(calibration: Calibration, *, verbose: bool = True) -> list[str]:
    """Return a line for each warning, unless `verbose` only for the most severe ones."""
    limit = None if verbose else MAX_WARNINGS
    warnings = calibration.warnings[:limit]
    lines = [
        f"warning ({warning.severity}): {warning} [{_about(calibration, warning)}]"
        for warning in warnings
    ]
    omitted = len(calibration.warnings) - len(lines)
    if omitted:
        lines.append(f"and {omitted} more: --verbose")
    return lines


def _about(calibration: Calibration, warning: CalibrationWarning) -> str:
    """Return a warning's code and, if there are several pictures, the picture of its plane."""
    if warning.plane is None or not calibration.pictures:
        return warning.code
    image = calibration.planes[warning.plane].image
    return f"{warning.code}; plane {warning.plane} is in picture {_picture(calibration, image)}"
