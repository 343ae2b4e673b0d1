"""Warnings from the core's solution, and about faults and tone curves of the pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set

import trisquare._core as _core
from trisquare._support.number_text import listed
from trisquare.calibration.fault_warnings import SPOILT_TEXTS, fault_warnings
from trisquare.calibration.gather import Gathered
from trisquare.images.faults import PictureFaults
from trisquare.images.tone import (
    PictureTone,
    contradicting_pictures,
    contradiction_text,
    shift_text,
)
from trisquare.results.calibration_warning import CalibrationWarning

NO_SQUARES_HINT = '. Sheets of paper and other rectangles have to be named: targets="a4"'
"""Addition to a warning that the squares are inconsistent."""

OTHER_OUTLINE_HINT = (
    ". An outline may be that of a print on a sheet, or of a frame around it: check the outlines "
    "(--debug-image, draw_detections), and give the right ones (outlines=)"
)
"""Addition to a warning that rectangles of a stated shape are inconsistent."""

NO_CURVE_HINT = (
    ". No tone curve fits the picture, as is common for phones, which may also be the cause: "
    "state the curve (tone=), or take the picture with less processing"
)
"""Addition to such a warning if the profiles of a picture fit no tone curve."""


def solution_warnings(
    solution: _core.Solution, gathered: Gathered, tones: Mapping[int, PictureTone]
) -> Iterator[CalibrationWarning]:
    """Warn of possible errors of the solution; `tones` are the pictures' tone curves, by index."""
    contradicting = contradicting_pictures(tones, gathered.names)
    # The core's warning, from the fit to the pixels, also states the effect on the camera.
    codes = {warning.code for warning in solution.warnings}
    if contradicting and "tone_contradicted" not in codes:
        text = contradiction_text(contradicting)
        yield CalibrationWarning(text, "tone_contradicted", "high")
    faults = _faults(gathered)
    picture_warnings = fault_warnings(faults, tones, gathered.names)
    yield from picture_warnings
    yield from _shift_warnings(solution, gathered, tones, faults)
    spoilt = [
        SPOILT_TEXTS[warning.code] for warning in picture_warnings if warning.code in SPOILT_TEXTS
    ]
    hints = _contradiction_hints(gathered, spoilt, codes)
    if any(tone.shift is not None for tone in tones.values()):
        hints += NO_CURVE_HINT
    for warning in solution.warnings:
        text = warning.text
        if warning.code == "planes_contradict":
            text += hints
        if warning.picture is not None:
            name = gathered.names[gathered.images[warning.picture]]
            text = contradiction_text(contradicting or name, text)
        yield CalibrationWarning(text, warning.code, warning.severity, warning.plane)


def _faults(gathered: Gathered) -> dict[int, PictureFaults]:
    """Return the faults, by index, of the pictures in which something was measured.

    Other pictures, such as repeated ones, have no faults and no curve.
    """
    measured = {figure.image for figure in gathered.figures}
    faults = zip(gathered.images, gathered.faults, strict=True)
    return {image: picture_faults for image, picture_faults in faults if image in measured}


def _shift_warnings(
    solution: _core.Solution,
    gathered: Gathered,
    tones: Mapping[int, PictureTone],
    faults: Mapping[int, PictureFaults],
) -> Iterator[CalibrationWarning]:
    """Warn of pictures that fit no tone curve, unless a fault with its own warning explains it."""
    # On a board, whose cells alternate, the shift cancels.
    drifting = {figure.image for figure in gathered.figures if figure.drift is not None}
    faultless = {image for image, picture_faults in faults.items() if not picture_faults.is_shifted}
    shifted = {image: tones[image] for image in drifting & faultless}
    if text := shift_text(shifted, gathered.names, solution.tone_growth):
        yield CalibrationWarning(text, "no_tone_curve", "low")


def _contradiction_hints(gathered: Gathered, spoilt: Sequence[str], codes: Set[str]) -> str:
    """Return possible reasons for planes that contradict each other.

    `spoilt` are descriptions of the picture's faults, `codes` those of the core's warnings.
    """
    hints = ""
    if spoilt:
        hints += (
            f". The picture is {listed(spoilt)}, which may be the cause: take a better picture "
            "first"
        )
    # Sheets of paper taken for squares leave the camera undetermined; a shear has its own warning.
    are_far_off = "barely_determined" in codes and "pixels_not_square" not in codes
    kinds = {figure.kind for figure in gathered.figures}
    if gathered.images and are_far_off:
        if kinds <= {"square", "frame"}:
            hints += NO_SQUARES_HINT
        elif kinds <= {"rectangle"}:
            hints += OTHER_OUTLINE_HINT
    return hints
