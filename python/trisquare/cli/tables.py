"""Results as tables for the terminal; only the `trisquare` command needs rich."""

from __future__ import annotations

import numpy as np
from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from trisquare._support.number_text import decimals_shown
from trisquare._support.rotations import tilt_degrees
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.results.calibration import Calibration
from trisquare.results.rejected import is_reported

MOST_REJECTED = 10
"""Lines on candidates that were not used: the results are to be read first."""


def calibration_report(calibration: Calibration) -> list[RenderableType]:
    """Lay out the parameters, the planes and the warnings."""
    return [
        _parameter_table(calibration),
        _plane_table(calibration),
        _summary(calibration),
        *_rejected(calibration),
        *_warnings(calibration),
    ]


def comparison_report(calibration: Calibration, truth: Camera) -> list[RenderableType]:
    """Lay out the estimate beside the truth."""
    table = Table("parameter", box=box.SIMPLE_HEAD)
    for heading in ("estimate", "std", "truth", "error", "error / std"):
        table.add_column(heading, justify="right")
    true_values = camera_parameters(truth)
    for name, value in camera_parameters(calibration.camera).items():
        if name not in calibration.std:
            continue
        std, error = calibration.std[name], value - true_values[name]
        decimals = decimals_shown(std)
        table.add_row(
            name,
            f"{value:.{decimals}f}",
            f"{std:.{decimals}f}",
            f"{true_values[name]:.{decimals}f}",
            f"{error:+.{decimals}f}",
            f"{error / std:+.1f}" if std > 0 else "",
        )
    return [table, _summary(calibration), *_warnings(calibration)]


def _parameter_table(calibration: Calibration) -> Table:
    table = Table("parameter", box=box.SIMPLE_HEAD)
    for heading in ("value", "std"):
        table.add_column(heading, justify="right")
    for name, value in camera_parameters(calibration.camera).items():
        if name in calibration.std:
            decimals = decimals_shown(calibration.std[name])
            std = f"{calibration.std[name]:.{decimals}f}"
            table.add_row(name, f"{value:.{decimals}f}", std)
        elif value != 0 or name in ("fx", "fy", "cx", "cy"):
            table.add_row(name, f"{value:.6g}", "held")
    return table


def _plane_table(calibration: Calibration) -> Table:
    table = Table("plane", "kind", box=box.SIMPLE_HEAD)
    for heading in ("image", "distance", "tilt deg", "rms px", "samples"):
        table.add_column(heading, justify="right")
    for number, plane in enumerate(calibration.planes):
        tilt = tilt_degrees(plane.rotation)
        table.add_row(
            str(number),
            Text(plane.kind),
            str(plane.image),
            f"{np.linalg.norm(plane.translation):.3f}",
            f"{tilt:.1f}",
            f"{plane.rms:.4f}",
            str(plane.samples),
        )
    return table


def _summary(calibration: Calibration) -> Text:
    width, height = calibration.camera.image_size
    rejected = ", ".join(
        f"{other.model} {other.log_evidence:.1f}" for other in calibration.alternatives
    )
    evidence = f" (by evidence; log odds of the others: {rejected})" if rejected else ""
    return Text(
        f"{width} x {height}, model {calibration.camera.model}{evidence}, "
        f"method {calibration.method} ({calibration.stage}): rms {calibration.rms:.4f} px, "
        f"noise scale {calibration.noise_scale:.2f}"
    )


def _rejected(calibration: Calibration) -> list[Text]:
    """Lay out a line for each of the first candidates that were not used, if no warning does."""
    lines = []
    untold = [
        candidate
        for candidate in calibration.rejected
        if not any(is_reported(warning, [candidate]) for warning in calibration.warnings)
    ]
    for candidate in untold[:MOST_REJECTED]:
        x, y = candidate.corners.mean(axis=0).tolist()
        residual = "" if candidate.residual is None else f", {candidate.residual:.3g} px"
        place = f"({x:.0f}, {y:.0f}) of image {candidate.image}"
        lines.append(f"not used: {candidate.kind} around {place}: {candidate.reason}{residual}")
    if len(untold) > MOST_REJECTED:
        lines.append(f"not used: {len(untold) - MOST_REJECTED} more")
    return [Text(line, style="dim") for line in lines]


def _warnings(calibration: Calibration) -> list[Text]:
    return [Text(f"warning: {warning}", style="yellow") for warning in calibration.warnings]
