"""Vignetting: error in pictures with dark corners.

The parameters are fx, fy, cx and cy.
"""

from __future__ import annotations

import numpy as np
from harness.faulty_pictures import calibrated
from harness.rows import Row
from harness.truth import PINHOLE, errors

from trisquare_scenes.picture_faults import PictureFault, darkened

SCENES = 40
SEED = 77
PARTS = (0.0, 0.25, 0.45)
"""Fraction of the light that is missing in the corners."""

NOISE, BLUR = 2.0, 1.2
MAX_STDS = 1.2


def measure() -> list[Row]:
    """Compare errors with the stated standard deviations."""
    rows = []
    for part in PARTS:
        deviations, focal = [], []
        fault = PictureFault(on_light=[darkened(part)])
        for scene, result in calibrated(fault, SCENES, SEED, noise=NOISE, blur=BLUR):
            off = errors(result, scene.camera)[: len(PINHOLE)]
            deviations.append(off / [result.std[name] for name in PINHOLE])
            focal.append(off[0] / scene.camera.fx)
        rms = np.sqrt(np.mean(np.square(deviations), axis=0))
        rows.append(
            Row(
                f"corners darkened by {100 * part:.0f} %, {SCENES} pictures: error / std, rms, "
                "worst parameter; mean error of fx",
                f"{rms.max():.2f}; {100 * np.mean(focal):+.4f} %",
                f"<= {MAX_STDS}",
                bool(rms.max() <= MAX_STDS),
            )
        )
    return rows
