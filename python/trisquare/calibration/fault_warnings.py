"""Warnings of faults of pictures that their edges' profiles show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from trisquare.images.faults import CLIPPED, PictureFaults
from trisquare.images.tone import PictureTone
from trisquare.results.calibration_warning import CalibrationWarning

WARNED_COLOUR_SHIFT = 0.4
"""Pixels by which a colour is displaced in the picture's corners, from which a warning says so:
most lenses have some of it, and the core measures green alone from less on."""

WARNED_MOTION = 3.0
"""Length of a motion in pixels from which a warning says so."""

WARNED_BLUR = 2.5
"""Blur in pixels, one standard deviation, from which a warning says so where no motion explains it:
among scattered things, of 24 scenes with 1 and 2 px none was wrong beyond 3 standard deviations, of
52 with 2.5 to 4 px 8 were."""

MUCH_LOST = 0.02
"""Pixels of each side's place that clipped light leaves unknown, from which on it is likely to be
what other warnings are about."""


def fault_warnings(
    faults: Mapping[int, PictureFaults], tones: Mapping[int, PictureTone], names: Sequence[str]
) -> list[CalibrationWarning]:
    """Warn of what is wrong with the pictures, by index.

    `names` is what messages call each of all pictures.
    """
    texts: dict[str, list[str]] = {}
    for image, own in faults.items():
        for code, text in _texts(own, tones[image]).items():
            texts.setdefault(code, []).append(f"{names[image]}: {text}")
    # A pattern, or what reaches into blurred edges, may be why sides are blamed.
    medium = {"periodic_pattern", "out_of_focus"}
    if any(own.colour_shift is not None and not own.is_green for own in faults.values()):
        medium.add("chromatic_aberration")
    if any(own.clipped > CLIPPED and own.line_error > MUCH_LOST for own in faults.values()):
        medium.add("overexposed")
    return [
        CalibrationWarning(
            f"{_ADVICE[code]} ({'; '.join(each)})",
            code,
            "medium" if code in medium else "low",
        )
        for code, each in texts.items()
    ]


SPOILT = {
    "overexposed": "overexposed",
    "motion_blurred": "blurred by motion",
    "out_of_focus": "out of focus",
}
"""What a picture is that has these warnings, which may move edges unevenly."""


_ADVICE = {
    "interlaced": (
        "the odd rows show another moment or place than the even ones, which alone are measured: "
        "the camera is that of the even rows; photograph without interlacing"
    ),
    "chromatic_aberration": (
        "the lens magnifies the colours differently: the camera is that of green light"
    ),
    "overexposed": (
        "the light beside the edges is clipped at white, which moves them: clipped pixels are "
        "taken as bounds, and standard deviations grew by what they leave unknown; photograph with "
        "a shorter exposure, so that the light ground is no longer pure white"
    ),
    "thresholded": (
        "the picture is black and white only, which makes the edges staircases and moves all of "
        "them toward dark or light: one common shift is estimated; scan in grey levels"
    ),
    "motion_blurred": (
        "the camera or the targets moved while the shutter was open, which blurs the edges more "
        "in one direction: standard deviations grew by what the shape of the blur leaves "
        "unknown; expose for a shorter time"
    ),
    "out_of_focus": (
        "the edges are so blurred that things beside them shift them. If the picture was blurred "
        "or enlarged after it was coded, that also hides how far its tone curve shifted them; "
        "standard deviations include it. Focus on the targets, keep other things away from them, "
        "and use the picture as it was recorded"
    ),
    "periodic_pattern": (
        "a fine pattern lies over the picture (moire, the grid of a screen, the raster of a "
        "print), which shifts the edges back and forth: good sides may be rejected for it, or "
        "taken for hidden; photograph plain paper in place of a screen, or from another distance"
    ),
}


def _texts(own: PictureFaults, tone: PictureTone) -> dict[str, str]:
    texts = {}
    if own.row_shift is not None:
        x, y = own.row_shift
        texts["interlaced"] = f"displaced by ({x:+.2f}, {y:+.2f}) px"
    if own.colour_shift is not None and max(map(abs, own.colour_shift)) > WARNED_COLOUR_SHIFT:
        blue, red = own.colour_shift
        hardly = "" if own.is_green else ", but the targets hardly show in green: all are measured"
        texts["chromatic_aberration"] = (
            f"in the corners blue lies {blue:+.2f} px and red {red:+.2f} px outward{hardly}"
        )
    if own.motion is not None and own.motion[0] > WARNED_MOTION:
        texts["motion_blurred"] = (
            f"by {own.motion[0]:.1f} px at {own.motion[1]:.0f} degrees from the x axis"
        )
    elif own.blur > WARNED_BLUR:
        texts["out_of_focus"] = (
            f"by {own.blur:.1f} px (standard deviation), reaching four times as far"
        )
    if own.pattern is not None:
        texts["periodic_pattern"] = f"waves of {100.0 * own.pattern:.0f} % of the targets' contrast"
    shift = "" if tone.shift is None else f", shift {tone.shift[0]:+.2f} +- {tone.shift[1]:.2f} px"
    if own.has_two_levels:
        texts["thresholded"] = "all pixels" + shift
    elif own.clipped > CLIPPED:
        texts["overexposed"] = f"{100.0 * own.clipped:.0f} % of the sides{shift}"
    return texts
