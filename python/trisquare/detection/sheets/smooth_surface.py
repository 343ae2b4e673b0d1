"""Where a lens shows the points of a sheet that it bends: a robust cubic over the sheet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import FloatArray

ROUNDS = 8
"""Of reweighting."""

MIN_SCALE = 0.1
"""Pixels that are no error."""

MIN_POINTS = 20
"""Twice as many as a cubic has terms: with fewer it would follow the points that are wrong."""


class SmoothSurface(NamedTuple):
    """A cubic from sheet coordinates to pixels."""

    middle: FloatArray  # (2,), sheet coordinates
    extent: float  # likewise
    terms: FloatArray  # (10, 2), pixels

    @classmethod
    def of(cls, model: FloatArray, seen: FloatArray) -> SmoothSurface:
        """Fit one to points of a sheet, shape (N, 2), and where they are seen, likewise."""
        middle = model.mean(axis=0)
        extent = float(np.abs(model - middle).max())
        powers = _cubic((model - middle) / extent)
        weights = np.ones(len(seen))
        for _ in range(ROUNDS):
            scaled = weights[:, None]
            terms = np.linalg.lstsq(powers * scaled, seen * scaled, rcond=None)[0]
            off = np.linalg.norm(powers @ terms - seen, axis=1)
            weights = 1.0 / np.hypot(1.0, off / max(2.0 * float(np.median(off)), MIN_SCALE))
        return cls(middle, extent, np.asarray(terms, np.float64))

    def at(self, points: FloatArray) -> FloatArray:
        """Return where points of the sheet, shape (..., 2), are seen."""
        flat = (points.reshape(-1, 2) - self.middle) / self.extent
        return np.asarray(_cubic(flat) @ self.terms).reshape(points.shape)


def _cubic(points: FloatArray) -> FloatArray:
    """Return the ten terms of a cubic in two variables at points."""
    x, y = points.T
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
