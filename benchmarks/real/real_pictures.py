"""The shared photographs, and the blur and noise of each."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
CHESS = DATA / "opencv-chess"

# JPEG codes blocks of 8 x 8. The calmest quarter of them has noise and no texture.
BLOCK = 8
CALM_QUANTILE = 0.25
# Rounding to whole grey levels makes a lower noise look like none.
MIN_NOISE = 0.5

# Blur is measured at the strongest edges, three pixels in a thousand.
EDGE_QUANTILE = 0.997
REBLUR = 1.5  # pixels
# Variance that the pixel's box and the central difference add to that of the lens's own blur.
MEASURING_VARIANCE = 1.0 / 12.0 + 1.0 / 3.0
BLUR_RANGE = (0.4, 2.0)


def photographs() -> list[Path]:
    """Return all shared photographs, in a fixed order; an empty list without the data."""
    return sorted(DATA.glob("*/*.jpg")) + sorted(DATA.glob("*/*/*.jpg"))


def noise_of(grey: Grey) -> float:
    """Estimate the standard deviation of a photograph's noise, in grey levels.

    It is the residual of a plane fitted to each block, in the calmest blocks.
    """
    rows, columns = (BLOCK * (side // BLOCK) for side in grey.shape)
    blocks = grey[:rows, :columns].astype(np.float64).reshape(-1, BLOCK, columns // BLOCK, BLOCK)
    pixels = blocks.swapaxes(1, 2).reshape(-1, BLOCK * BLOCK)
    y, x = np.indices((BLOCK, BLOCK)).reshape(2, -1)
    basis = np.linalg.qr(np.stack([np.ones_like(x), x, y], axis=1))[0]
    left = pixels - (pixels @ basis) @ basis.T
    deviation = np.sqrt(np.sum(left**2, axis=1) / (pixels.shape[1] - basis.shape[1]))
    unclipped = (pixels.min(axis=1) > 0) & (pixels.max(axis=1) < 255)
    return max(float(np.quantile(deviation[unclipped], CALM_QUANTILE)), MIN_NOISE)


def blur_of(grey: Grey) -> float:
    """Estimate the optical blur of a photograph's sharp edges, in pixels.

    A known additional blur lowers the slope of an edge by sqrt(1 + reblur^2 / blur^2).
    """
    light = grey.astype(np.float64)
    slope = _slope(light)
    softer = _slope(cv2.GaussianBlur(light, (0, 0), REBLUR))
    strong = slope >= np.quantile(slope, EDGE_QUANTILE)
    ratio = float(np.median(slope[strong] / softer[strong]))
    variance = REBLUR**2 / max(ratio**2 - 1.0, 1e-3) - MEASURING_VARIANCE
    return float(np.clip(np.sqrt(max(variance, 0.0)), *BLUR_RANGE))


def _slope(light: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    down, right = np.gradient(light)
    return np.hypot(down, right)
