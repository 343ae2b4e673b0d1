"""Boards printed on paper: standard deviation of a pixel of edge.

It is the rms of the residuals times the square root of the length of edge per independent sample.
The required value is the one that `predict` assumes for printed targets.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from harness.rows import NotMeasurableError, Row
from real.real_pictures import photographs

import trisquare as ts
from trisquare.analysis.predict import PRINTED_SIGMA

HELD = ("principal_point", "aspect", "distortion")
"""Parameters held where a photograph alone does not determine the camera."""
TOLERANCE = 1.5


def measure() -> list[Row]:
    """Measure all photographs."""
    sigmas = np.array(list(_sigmas()))
    if not len(sigmas):
        raise NotMeasurableError("no ../shared/data, or no board in it")
    low, median, high = np.quantile(sigmas, [0.1, 0.5, 0.9])
    ratio = max(median / PRINTED_SIGMA, PRINTED_SIGMA / median)
    return [
        Row(
            f"{len(sigmas)} photographs: std of a pixel of edge, median (10 %, 90 % quantile)",
            f"{median:.1f} px ({low:.1f}, {high:.1f})",
            f"{PRINTED_SIGMA:g} px, within a factor of {TOLERANCE:g}",
            bool(ratio <= TOLERANCE),
        )
    ]


def _sigmas() -> Iterator[float]:
    for path in photographs():
        with suppress(ts.TrisquareError):
            try:
                result = ts.calibrate(path)
            except ts.TrisquareError:
                result = ts.calibrate(path, fix=HELD)
            lines = [line for figure in result.edges for line in figure.points]
            spacing = np.median(
                [
                    np.hypot(*(line[-1] - line[0])) / (len(line) - 1)
                    for line in lines
                    if len(line) > 1
                ]
            )
            assert result.coherence is not None
            yield result.rms * float(np.sqrt(spacing * result.coherence.neighbours))
