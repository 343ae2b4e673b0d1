"""Warnings of faults of pictures, which the edge profiles show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from trisquare.images.faults import MAX_CLIPPED_SHARE, PictureFaults
from trisquare.images.tone import PictureTone
from trisquare.results.calibration_warning import CalibrationWarning

WARNED_COLOUR_SHIFT = 0.4
"""Displacement of a colour in the picture's corners (px) above which a warning is given: most
lenses displace colours somewhat, and the core measures green alone from a smaller value on."""

WARNED_MOTION = 3.0
"""Length of a motion (px) above which a warning is given."""

WARNED_BLUR = 2.5
"""Blur, as a standard deviation (px), above which a warning is given if no motion explains it:
among cluttered scenes, none of 24 with 1 and 2 px was wrong by more than 3 standard deviations, and
8 of 52 with 2.5 to 4 px were."""

MAX_CLIPPING_ERROR = 0.02
"""Uncertainty of each side's position due to clipped light (px) above which clipping is a likely
cause of other warnings."""


def fault_warnings(
    faults: Mapping[int, PictureFaults], tones: Mapping[int, PictureTone], names: Sequence[str]
) -> list[CalibrationWarning]:
    """Warn of the pictures' faults, which are given by picture index.

    `names` are the names of all pictures in messages.
    """
    texts: dict[str, list[str]] = {}
    for image, picture_faults in faults.items():
        for code, text in _texts(picture_faults, tones[image]).items():
            texts.setdefault(code, []).append(f"{names[image]}: {text}")
    # A pattern, or things within reach of blurred edges, may be the reason for rejected sides.
    medium = {"periodic_pattern", "out_of_focus"}
    if any(
        picture_faults.colour_shift is not None and not picture_faults.is_green
        for picture_faults in faults.values()
    ):
        medium.add("chromatic_aberration")
    if any(
        picture_faults.clipped > MAX_CLIPPED_SHARE
        and picture_faults.line_error > MAX_CLIPPING_ERROR
        for picture_faults in faults.values()
    ):
        medium.add("overexposed")
    return [
        CalibrationWarning(
            f"{_ADVICE[code]} ({'; '.join(examples)})",
            code,
            "medium" if code in medium else "low",
        )
        for code, examples in texts.items()
    ]


SPOILT_TEXTS = {
    "overexposed": "overexposed",
    "motion_blurred": "blurred by motion",
    "out_of_focus": "out of focus",
}
"""Description of a picture with such a warning, whose edges may be shifted unevenly."""


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


def _texts(faults: PictureFaults, tone: PictureTone) -> dict[str, str]:
    texts = {}
    if faults.row_shift is not None:
        x, y = faults.row_shift
        texts["interlaced"] = f"displaced by ({x:+.2f}, {y:+.2f}) px"
    if faults.colour_shift is not None and max(map(abs, faults.colour_shift)) > WARNED_COLOUR_SHIFT:
        blue, red = faults.colour_shift
        addition = (
            "" if faults.is_green else ", but the targets hardly show in green: all are measured"
        )
        texts["chromatic_aberration"] = (
            f"in the corners blue lies {blue:+.2f} px and red {red:+.2f} px outward{addition}"
        )
    if faults.motion is not None and faults.motion[0] > WARNED_MOTION:
        texts["motion_blurred"] = (
            f"by {faults.motion[0]:.1f} px at {faults.motion[1]:.0f} degrees from the x axis"
        )
    elif faults.blur > WARNED_BLUR:
        texts["out_of_focus"] = (
            f"by {faults.blur:.1f} px (standard deviation), reaching four times as far"
        )
    if faults.pattern is not None:
        texts["periodic_pattern"] = (
            f"waves of {100.0 * faults.pattern:.0f} % of the targets' contrast"
        )
    shift = "" if tone.shift is None else f", shift {tone.shift[0]:+.2f} +- {tone.shift[1]:.2f} px"
    if faults.has_two_levels:
        texts["thresholded"] = "all pixels" + shift
    elif faults.clipped > MAX_CLIPPED_SHARE:
        texts["overexposed"] = f"{100.0 * faults.clipped:.0f} % of the sides{shift}"
    return texts
