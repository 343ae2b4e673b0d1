"""Measuring what was found: OpenCV finds the outlines, Rust measures their sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.annotations.outlines import AnnotatedSquare
from trisquare.detection.kinds import TargetKinds
from trisquare.edges import PlaneEdges
from trisquare.images.pixels import Image
from trisquare.images.tone import PictureTone
from trisquare.measurement.find import Search, search, search_annotated
from trisquare.measurement.side_spans import DetectedTarget, SideSpan
from trisquare.results.rejected import Rejected

TOO_FEW_LINES = "too few of its lines could be measured"


class MeasuredTargets(NamedTuple):
    """What was measured in a picture; all lists may be empty.

    `quads` holds, for each plane by its number, four points (4, 2) that enclose it.
    """

    figures: list[PlaneEdges]
    tone: PictureTone
    rejected: list[Rejected]
    quads: list[FloatArray]
    search: Search


def measure(
    picture: Image,
    core: _core.Picture,
    targets: TargetKinds,
    tone: str | float,
    annotated: Sequence[AnnotatedSquare] | None = None,
) -> MeasuredTargets:
    """Find the targets in a checked picture and measure them.

    With `annotated` targets nothing else is looked for.
    """
    if annotated is None:
        searched = search(picture, targets)
        names = [""] * len(searched.found)
    else:
        searched = search_annotated(picture, annotated)
        names = [f"{target.where}: " for target in annotated]
    rejected = [candidate for candidate in searched.found if isinstance(candidate, Rejected)]
    named = [
        (candidate, name)
        for candidate, name in zip(searched.found, names, strict=True)
        if not isinstance(candidate, Rejected)
    ]
    figures, picture_tone, not_measured = _measured(named, core, tone)
    quads = [target.quad for target in searched.targets]
    return MeasuredTargets(figures, picture_tone, rejected + not_measured, quads, searched)


def _measured(
    found: Sequence[tuple[DetectedTarget, str]], core: _core.Picture, tone: str | float
) -> tuple[list[PlaneEdges], PictureTone, list[Rejected]]:
    """Measure what was found; each with the name that its rejection begins with."""
    spans: list[SideSpan] = []
    ends = [0]
    for target, _ in found:
        spans += target.spans(len(spans))
        ends.append(len(spans))
    measured, estimate = _core.localise(core, spans, None if tone == "auto" else tone)
    if tone == "auto":
        picture_tone = PictureTone.estimated(estimate)
    else:
        picture_tone = PictureTone.known(tone, estimate)
    figures: list[PlaneEdges] = []
    rejected: list[Rejected] = []
    for plane, (target, name) in enumerate(found):
        own = measured[ends[plane] : ends[plane + 1]]
        edges = target.figures(own, plane)
        figures += edges
        if not edges:
            reasons = {reason for reason in own if isinstance(reason, str)}
            reason = name + ("; ".join(sorted(reasons)) or TOO_FEW_LINES)
            rejected.append(Rejected(target.kind, 0, target.quad, reason))
    # Boards and sheets have taken every shift away, whose drift the others still carry.
    if figures and all(figure.drift is None for figure in figures):
        picture_tone = picture_tone.of_board()
    return figures, picture_tone, rejected
