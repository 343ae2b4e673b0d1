"""Radial distortion with a few coefficients, in units of half the picture's diagonal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray

FAMILIES = ("division", "polynomial")

NEWTON_STEPS = 60
NEWTON_TOLERANCE = 1e-14
"""Change of a squared radius, over one plus that, at which Newton's method ends."""

USED_FOLD_SHARE = 0.995
"""Fraction of the fold's radius up to which a lens is used: at the fold itself nothing is known."""

MAX_IDEAL_RADIUS = 6.0
"""Ideal radius up to which points are undistorted: 80 degrees from the axis of a lens whose focal
length is half the diagonal."""

TINY = 1e-12


@dataclass(frozen=True, slots=True)
class RadialLens:
    """A radial distortion about the origin: ``q_ideal = q / D(|q|^2)``.

    The line ``n . q_ideal + d = 0`` is seen as ``n . q + d D = 0``.

    Parameters
    ----------
    family : {"division", "polynomial"}
        ``D = 1 + a1 s + a2 s^2 + ...`` with ``s = |q|^2`` (A. Fitzgibbon, CVPR 2001), or the same
        with ``s = |q_ideal|^2``, which is OpenCV's ``k1, k2, k3`` in another unit (F. Devernay & O.
        Faugeras, Machine Vision and Applications 13 (2001) 14-24).
    coefficients : ndarray, shape (C,)
        ``a1, a2, ...``.
    """

    family: str
    coefficients: FloatArray

    def divisor(self, square: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ``D`` at squared observed radii, its derivatives by them and by the coefficients.

        Beyond the fold of a polynomial the ideal radius stays at its largest.

        Returns
        -------
        divisor, slope : ndarray, shape (P,)
        by_coefficients : ndarray, shape (P, C)
        """
        if self.family == "division":
            divisor, slope = self._divisor_of(square)
            return divisor, slope, square[:, None] ** self._powers
        ideal, is_folded = self._ideal_squares(square)
        divisor, inner = self._divisor_of(ideal)
        growth = np.maximum(divisor * (divisor + 2 * ideal * inner), TINY)
        slope = inner / growth
        # A coefficient changes the ideal radius such that the observed one is constant.
        direct_share = 1 - inner * 2 * ideal * divisor / growth
        by_coefficients = direct_share[:, None] * ideal[:, None] ** self._powers
        if is_folded.any():
            divisor[is_folded] = np.sqrt(square[is_folded] / ideal[is_folded])
            slope[is_folded] = 0.5 / np.sqrt(square[is_folded] * ideal[is_folded])
            by_coefficients[is_folded] = 0.0
        return divisor, slope, by_coefficients

    @property
    def _powers(self) -> FloatArray:
        return np.arange(1.0, len(self.coefficients) + 1)

    def _divisor_of(self, squares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``D`` as a function of its own ``s``, and its derivative."""
        divisor, slope = np.zeros_like(squares), np.zeros_like(squares)
        for coefficient in (*self.coefficients[::-1], 1.0):
            slope = divisor + squares * slope
            divisor = coefficient + squares * divisor
        return divisor, slope

    def _ideal_squares(self, square: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Return squared ideal radii of a polynomial, and which points lie beyond its fold."""
        largest = USED_FOLD_SHARE**2 * self._fold()

        def observed(ideal: FloatArray) -> tuple[FloatArray, FloatArray]:
            factor, slope = self._divisor_of(ideal)
            return ideal * factor**2, factor * (factor + 2 * ideal * slope)

        is_folded = np.zeros(len(square), dtype=bool)
        if np.isfinite(largest):
            is_folded = square >= observed(np.array([largest]))[0][0]
        ideal = np.where(is_folded, largest, np.minimum(square, largest))
        low, high = np.zeros_like(ideal), np.full_like(ideal, largest)
        for _ in range(NEWTON_STEPS):
            value, growth = observed(ideal)
            errors = np.where(is_folded, 0.0, value - square)
            low, high = np.where(errors < 0, ideal, low), np.where(errors > 0, ideal, high)
            next_ideal = ideal - errors / np.maximum(growth, TINY)
            middle = np.where(np.isfinite(high), 0.5 * (low + high), 2 * low + 1)
            next_ideal = np.where((next_ideal >= low) & (next_ideal <= high), next_ideal, middle)
            is_done = np.abs(next_ideal - ideal) <= NEWTON_TOLERANCE * (1 + ideal)
            ideal = next_ideal
            if is_done.all():
                break
        return ideal, is_folded

    def _fold(self) -> float:
        """Return the fold's squared radius: ideal for a polynomial, observed for a division model.

        It is where ``1 + 3 a1 s + 5 a2 s^2 + ...``, or ``1 - a1 s - 3 a2 s^2 - ...``, first
        vanishes.
        """
        factors = 1 + (-2 if self.family == "division" else 2) * self._powers
        roots = np.roots([*(factors * self.coefficients)[::-1], 1.0])
        positive = roots.real[(np.abs(roots.imag) < TINY) & (roots.real > 0)]
        return float(positive.min(initial=np.inf))

    def largest_radius(self) -> float:
        """Return the observed radius up to which points are undistorted; infinite if unlimited."""
        fold = np.sqrt(self._fold()) * USED_FOLD_SHARE
        if self.family == "polynomial":
            return float(self.observed_radius(np.array([min(fold, MAX_IDEAL_RADIUS)]))[0])
        # The ideal radius increases up to where the divisor vanishes.
        limit = fold if np.isfinite(fold) else 1e3
        radii = np.linspace(0.0, min(limit, 10.0), 20001)
        divisor = self.divisor(radii**2)[0]
        beyond = np.nonzero(radii > MAX_IDEAL_RADIUS * divisor)[0]
        return float(radii[beyond[0] - 1]) if len(beyond) else float(limit)

    def ideal_radius(self, observed: FloatArray) -> FloatArray:
        """Return ideal radii of observed ones that are not beyond the largest."""
        return np.asarray(observed / self.divisor(observed**2)[0])

    def observed_radius(self, ideal: FloatArray) -> FloatArray:
        """Return observed radii of ideal ones that are not beyond the largest."""
        if self.family == "polynomial":
            return np.asarray(ideal * self._divisor_of(ideal**2)[0])
        low = np.zeros_like(ideal)
        high = np.full_like(ideal, self.largest_radius())
        for _ in range(NEWTON_STEPS):
            middle = 0.5 * (low + high)
            is_below = middle < ideal * self.divisor(middle**2)[0]
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.asarray(0.5 * (low + high))
