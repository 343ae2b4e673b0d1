"""Choice of the planes that one camera explains, among those that were found and measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas
from trisquare.edges import PlaneEdges
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.rejected import Rejected

FALSE_PLANE_REASON = (
    "not exactly square (or of the stated shape) for the camera that the other planes determine"
)

MAX_SHAPE_RESIDUAL = 0.01
"""Residual, as a fraction of a target's size, above which the shape is another one, as in the
core."""

PLAIN_KINDS = {"square", "frame"}
"""Kinds that many things look like; boards and tags are not found by chance."""

MIN_SURE = 3
"""Number of agreeing planes of other kinds that leaves no doubt about the rejection of plain
squares."""


class Chosen(NamedTuple):
    """Figures to calibrate from, rejected candidates, and warnings."""

    figures: list[PlaneEdges]
    rejected: list[Rejected]
    warnings: list[CalibrationWarning]


def chosen_planes(
    outcome: _core.Outcome,
    figures: Sequence[PlaneEdges],
    quads: Mapping[int, FloatArray],
) -> Chosen:
    """Return the planes that the core kept: the largest set that is consistent with one camera.

    The core chose among the `figures`; `quads` has the corners, shape (4, 2), of every plane.
    """
    verdicts, doubt = outcome.verdicts, outcome.doubt
    dropped = {
        figures[candidate.figure].plane: candidate for candidate in verdicts if not candidate.kept
    }
    rejected = []
    for plane, verdict in dropped.items():
        if plane is not None:
            figure = figures[verdict.figure]
            rejected.append(
                Rejected(
                    figure.kind, figure.image, quads[plane], FALSE_PLANE_REASON, verdict.residual
                )
            )
    kept = [figure for figure in figures if figure.plane not in dropped]
    planes = {figure.plane for figure in kept if figure.plane is not None}
    smallest = min((float(quad_areas(quads[plane])) for plane in planes), default=0.0)
    larger = [candidate for candidate in rejected if quad_areas(candidate.corners) > smallest]
    warnings = []
    summary = f"one camera explains {len(planes)} of {len(verdicts)} planes found"
    if doubt is not None:
        text = (
            f"the choice among candidates is uncertain: {summary}, and {doubt}{_zoom_hint(figures)}"
        )
        warnings.append(CalibrationWarning(text, "choice_uncertain", "high"))
    elif larger:
        are = "shapes are" if len(larger) > 1 else "shape is"
        larger_ones = f"{len(larger)} rejected {are}"
        text = (
            f"{summary}; {larger_ones} larger than the smallest plane used: if one of them is a "
            f"true target, the result is wrong{_zoom_hint(figures)}"
        )
        sure_planes = {figure.plane for figure in kept if figure.kind not in PLAIN_KINDS}
        are_outvoted = (
            len(sure_planes) >= MIN_SURE and {candidate.kind for candidate in larger} <= PLAIN_KINDS
        )
        is_harmless = are_outvoted or all(map(_has_other_shape, larger))
        severity = "low" if is_harmless else "medium"
        warnings.append(CalibrationWarning(text, "larger_rejected", severity))
    return Chosen(kept, rejected, warnings)


def _zoom_hint(figures: Sequence[PlaneEdges]) -> str:
    """Return another possible cause if planes of several pictures are inconsistent."""
    if len({figure.image for figure in figures}) == 1:
        return ""
    return ". Were all pictures taken with one camera, zoom and focus?"


def _has_other_shape(candidate: Rejected) -> bool:
    """Return whether the shape of a rejected candidate is far from a target's."""
    if candidate.residual is None:
        return False
    return candidate.residual > MAX_SHAPE_RESIDUAL * math.sqrt(float(quad_areas(candidate.corners)))
