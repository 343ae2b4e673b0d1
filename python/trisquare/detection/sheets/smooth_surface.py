"""A robust cubic over a sheet that maps its points to pixels where the lens bends it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import FloatArray

ROUNDS = 8
"""Number of reweighting rounds."""

MIN_SCALE = 0.1
"""Minimum scale of the residuals in the weights, pixels."""

MIN_POINTS = 20
"""Minimum number of points, twice that of a cubic's terms: with fewer it would follow wrong
points."""


class SmoothSurface(NamedTuple):
    """A cubic from sheet coordinates to pixels."""

    middle: FloatArray  # (2,), sheet coordinates
    extent: float  # likewise
    terms: FloatArray  # (10, 2), pixels

    @classmethod
    def of(cls, model: FloatArray, seen: FloatArray) -> SmoothSurface:
        """Fit a cubic to points of a sheet, shape (N, 2), and their pixels, likewise."""
        middle = model.mean(axis=0)
        extent = float(np.abs(model - middle).max())
        powers = _cubic((model - middle) / extent)
        weights = np.ones(len(seen))
        for _ in range(ROUNDS):
            scaled = weights[:, None]
            terms = np.linalg.lstsq(powers * scaled, seen * scaled, rcond=None)[0]
            errors = np.linalg.norm(powers @ terms - seen, axis=1)
            weights = 1.0 / np.hypot(1.0, errors / max(2.0 * float(np.median(errors)), MIN_SCALE))
        return cls(middle, extent, np.asarray(terms, np.float64))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the pixels of points of the sheet, shape (..., 2)."""
        flat = (points.reshape(-1, 2) - self.middle) / self.extent
        return np.asarray(_cubic(flat) @ self.terms).reshape(points.shape)


def _cubic(points: FloatArray) -> FloatArray:
    """Return the ten terms of a cubic in two variables at points."""
    x, y = points.T
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
