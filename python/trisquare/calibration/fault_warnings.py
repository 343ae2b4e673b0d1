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
        "the odd rows were recorded at another time than the even rows, or are displaced: only "
        "the even rows are measured, and the camera is that of the even rows. Photograph without "
        "interlacing"
    ),
    "chromatic_aberration": (
        "the lens magnifies the colours differently: only green light is measured if the targets "
        "have enough contrast in it"
    ),
    "overexposed": (
        "the light beside the edges is clipped at white, which displaces them: clipped pixels are "
        "used as lower bounds of the light, and standard deviations were raised for the remaining "
        "uncertainty. Photograph with a shorter exposure, so that the light ground is no longer "
        "pure white"
    ),
    "thresholded": (
        "the picture has only black and white pixels, which makes its edges staircases and "
        "displaces all of them toward dark or light: one common shift is estimated, and standard "
        "deviations were raised. Scan in grey levels"
    ),
    "motion_blurred": (
        "the camera or the targets moved while the shutter was open, which blurs the edges more "
        "in one direction: standard deviations were raised for the unknown shape of the blur. "
        "Expose for a shorter time"
    ),
    "out_of_focus": (
        "the edges are so blurred that objects beside them displace them. If the picture was "
        "blurred or enlarged after it was encoded, the displacement of the edges by its tone "
        "curve cannot be measured; standard deviations include it. Focus on the targets, keep "
        "other objects away from them, and use the picture as it was recorded"
    ),
    "periodic_pattern": (
        "a fine pattern covers the picture (moire, the pixels of a screen, the raster of a print) "
        "and displaces the edges in both directions: good sides may be rejected because of it, or "
        "taken for hidden. Photograph plain paper instead of a screen, or from another distance"
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
            ""
            if faults.is_green
            else ", but the targets have little contrast in green: all colours are measured"
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
