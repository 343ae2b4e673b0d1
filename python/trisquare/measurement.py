"""Measuring what was found: OpenCV finds the outlines, Rust measures their sides."""

from __future__ import annotations

from typing import NamedTuple

from trisquare import _core
from trisquare.edges import PlaneEdges
from trisquare.finding import find
from trisquare.picture_tone import PictureTone
from trisquare.pictures import Image
from trisquare.rejected import Rejected
from trisquare.spans import Samples, Span
from trisquare.targets import Targets

TOO_FEW_LINES = "too few of its lines could be measured"


class Measurement(NamedTuple):
    """What was measured in a picture; both lists may be empty."""

    figures: list[PlaneEdges]
    tone: PictureTone
    rejected: list[Rejected]


def measure(
    picture: Image, core: _core.Picture, targets: Targets, tone: str | float
) -> Measurement:
    """Find the targets in a checked picture and measure them."""
    found = find(picture, targets)
    spans: list[Span] = []
    ends = [0]
    for target in found:
        spans += target.spans(len(spans))
        ends.append(len(spans))
    measured, picture_tone = _localise(core, spans, tone)
    figures: list[PlaneEdges] = []
    rejected = []
    for plane, target in enumerate(found):
        own = measured[ends[plane] : ends[plane + 1]]
        edges = target.figures(own, plane)
        figures += edges
        if not edges:
            reasons = {reason for reason in own if isinstance(reason, str)}
            reason = "; ".join(sorted(reasons)) or TOO_FEW_LINES
            rejected.append(Rejected(target.kind, 0, target.quad, reason))
    if found and all(target.kind == "chessboard" for target in found):
        picture_tone = picture_tone.of_board()
    return Measurement(figures, picture_tone, rejected)


def _localise(
    core: _core.Picture, spans: list[Span], tone: str | float
) -> tuple[list[Samples | str], PictureTone]:
    """Measure spans, and the tone curve where that is to be estimated."""
    measured, estimate = _core.localise(core, spans, None if tone == "auto" else tone)
    if estimate is None:
        return measured, PictureTone.known(tone)
    return measured, PictureTone.estimated(estimate)
