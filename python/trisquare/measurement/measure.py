"""Measurement of detected targets: OpenCV finds the outlines, Rust measures their sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.annotations.outlines import AnnotatedSquare
from trisquare.detection.kinds import TargetKinds
from trisquare.edges import PlaneEdges
from trisquare.images.faults import PictureFaults
from trisquare.images.pixels import Image
from trisquare.images.tone import PictureTone
from trisquare.measurement.find import Search, search, search_annotated
from trisquare.measurement.side_spans import DetectedTarget, SideSpan
from trisquare.results.rejected import Rejected

TOO_FEW_LINES = "too few of its lines could be measured"


class MeasuredTargets(NamedTuple):
    """The measurements in a picture; all lists may be empty.

    `pixels` are those near the measured outlines, of one field or colour if the others disagree
    with it. `quads` contains, for each plane by its number, four points (4, 2) that enclose it.
    """

    figures: list[PlaneEdges]
    tone: PictureTone
    faults: PictureFaults
    pixels: _core.KeptPixels
    rejected: list[Rejected]
    quads: list[FloatArray]
    search: Search


def measure(
    picture: Image,
    targets: TargetKinds,
    tone: str | float,
    annotated: Sequence[AnnotatedSquare] | None = None,
) -> MeasuredTargets:
    """Find the targets in a checked picture and measure them.

    With `annotated` targets nothing else is searched for.
    """
    if annotated is None:
        searched = search(picture, targets)
        names = [""] * len(searched.found)
    else:
        searched = search_annotated(picture, annotated, targets)
        names = [f"{target.where}: " for target in annotated]
    rejected = [candidate for candidate in searched.found if isinstance(candidate, Rejected)]
    named = [
        (candidate, name)
        for candidate, name in zip(searched.found, names, strict=True)
        if not isinstance(candidate, Rejected)
    ]
    spans: list[SideSpan] = []
    ends = [0]
    for target, _ in named:
        spans += target.spans(len(spans))
        ends.append(len(spans))
    measured, picture_tone, faults, core = _localised(spans, _core.Picture(picture), tone)
    by_target = [measured[start:end] for start, end in pairwise(ends)]
    figures, not_measured = _figures(named, by_target)
    # The shift of boards and sheets is removed; the others still have its drift.
    if figures and all(figure.drift is None for figure in figures):
        picture_tone = picture_tone.of_board()
    quads = [target.quad for target in searched.targets]
    rejected += not_measured
    blurs = [side.blur for side in measured if isinstance(side, _core.SideSamples)]
    pixels = core.near(figures, max(blurs, default=0.0))
    return MeasuredTargets(figures, picture_tone, faults, pixels, rejected, quads, searched)


def _localised(
    spans: list[SideSpan], core: _core.Picture, tone: str | float
) -> tuple[list[_core.SideSamples | str], PictureTone, PictureFaults, _core.Picture]:
    """Measure the spans in a picture, or in its self-consistent part; return which it was."""
    stated_tone = None if tone == "auto" else tone
    measured, estimate, found = _core.localise(core, spans, stated_tone)
    faults = PictureFaults.of(found)
    if (mended := found.mended(core)) is not None:
        core = mended
        measured, estimate, found = _core.localise(core, spans, stated_tone)
        faults = replace(
            PictureFaults.of(found),
            row_shift=faults.row_shift,
            colour_shift=faults.colour_shift,
            is_green=faults.is_green,
        )
    if tone == "auto":
        return measured, PictureTone.estimated(estimate), faults, core
    return measured, PictureTone.known(tone, estimate), faults, core


def _figures(
    found: Sequence[tuple[DetectedTarget, str]],
    measured: Sequence[list[_core.SideSamples | str]],
) -> tuple[list[PlaneEdges], list[Rejected]]:
    """Build the figures of each target; a rejection begins with the target's name."""
    figures: list[PlaneEdges] = []
    rejected: list[Rejected] = []
    for plane, ((target, name), sides) in enumerate(zip(found, measured, strict=True)):
        edges = target.figures(sides, plane)
        figures += edges
        if not edges:
            reasons = {reason for reason in sides if isinstance(reason, str)}
            reason = name + ("; ".join(sorted(reasons)) or TOO_FEW_LINES)
            rejected.append(Rejected(target.kind, 0, target.quad, reason))
    return figures, rejected
