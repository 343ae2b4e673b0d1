"""Blur that is larger in the corners of the picture, and defocus: error.

sRGB pictures. Blur is stated as the standard deviation of a Gaussian, defocus as the radius of a
disc. The parameters are fx, fy, cx and cy. Warned: there is a warning above low severity.
"""

from __future__ import annotations

import numpy as np
from harness.faulty_pictures import calibrated
from harness.rows import Row
from harness.truth import PINHOLE, errors

from trisquare_scenes.picture_faults import PictureFault, defocused

SCENES = 40
SEED = 91
NOISE = 1.0  # grey levels
BLURS = ((0.6, 0.6), (0.6, 0.85), (0.6, 1.2), (1.0, 2.0))
"""Standard deviation of the blur in the middle and in the corners, in pixels."""
DISC_BLUR = 0.6
DISCS = ((0.8, None), (1.6, None), (2.4, None), (1.6, 95), (1.6, 88))
"""Radius, in pixels, of the disc over which a defocused lens spreads light; JPEG quality."""
MAX_STDS = 1.3
MAX_ERROR = 0.01  # percent


def measure() -> list[Row]:
    """Compare errors with the stated standard deviations."""
    towards_corners = [
        _row(
            f"blur of {middle:g} px in the middle and {corners:g} px in the corners",
            PictureFault(corner_blur=corners),
            middle,
        )
        for middle, corners in BLURS
    ]
    out_of_focus = [
        _row(
            f"blur of {DISC_BLUR:g} px and defocus of {radius:g} px"
            + ("" if quality is None else f", JPEG {quality}"),
            PictureFault(on_light=[defocused(radius)], jpeg_quality=quality),
            DISC_BLUR,
        )
        for radius, quality in DISCS
    ]
    return towards_corners + out_of_focus


def _row(name: str, fault: PictureFault, blur: float) -> Row:
    deviations, focal, warned = [], [], 0
    for scene, result in calibrated(fault, SCENES, SEED, noise=NOISE, blur=blur):
        off = errors(result, scene.camera)[: len(PINHOLE)]
        deviations.append(off / [result.std[name] for name in PINHOLE])
        focal.append(abs(off[0]) / scene.camera.fx)
        warned += any(warning.severity != "low" for warning in result.warnings)
    rms = np.sqrt(np.mean(np.square(deviations), axis=0))
    median = 100 * float(np.median(focal))
    return Row(
        f"{name}, {SCENES} pictures: error / std, rms, worst parameter; median error of fx; warned",
        f"{rms.max():.2f}; {median:.4f} %; {warned}",
        f"<= {MAX_STDS}; <= {MAX_ERROR} %; 0",
        bool(rms.max() <= MAX_STDS and median <= MAX_ERROR and warned == 0),
    )
