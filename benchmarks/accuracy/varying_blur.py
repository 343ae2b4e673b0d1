"""Lenses that blur the corners of their pictures more: whether that moves the edges."""

from __future__ import annotations

import numpy as np
from harness.rows import Row
from harness.spoilt_pictures import calibrated
from harness.truth import PINHOLE, errors

from trisquare_scenes.picture_faults import PictureFault

SCENES = 40
SEED = 91
NOISE = 1.0  # grey levels
BLURS = ((0.6, 0.6), (0.6, 0.85), (0.6, 1.2), (1.0, 2.0))
"""In the middle and in the corners, pixels."""
MOST_STDS = 1.3
MOST_ERROR = 0.01  # percent


def measure() -> list[Row]:
    """Compare errors with the stated standard deviations."""
    rows = []
    for middle, corners in BLURS:
        deviations, focal, warned = [], [], 0
        fault = PictureFault(corner_blur=corners)
        for scene, result in calibrated(fault, SCENES, SEED, noise=NOISE, blur=middle):
            off = errors(result, scene.camera)[: len(PINHOLE)]
            deviations.append(off / [result.std[name] for name in PINHOLE])
            focal.append(abs(off[0]) / scene.camera.fx)
            warned += any(warning.severity != "low" for warning in result.warnings)
        rms = np.sqrt(np.mean(np.square(deviations), axis=0))
        median = 100 * float(np.median(focal))
        rows.append(
            Row(
                f"sRGB, blur from {middle:g} px in the middle to {corners:g} px in the corners, "
                f"{SCENES} pictures: error / std rms, worst parameter; median error of fx; warned",
                f"{rms.max():.2f}; {median:.4f} %; {warned}",
                f"<= {MOST_STDS}; <= {MOST_ERROR} %; 0",
                bool(rms.max() <= MOST_STDS and median <= MOST_ERROR and warned == 0),
            )
        )
    return rows
