"""Curves that are images of straight lines, and their deviation from that under a lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.straightening.radial import RadialLens

Scalar = TypeVar("Scalar", bound=np.generic)

REWEIGHTINGS = 3
"""Number of fits of a line, each with the gradients from the one before."""

TINY = 1e-12


@dataclass(frozen=True, slots=True)
class CentredLens:
    """A radial distortion about a centre, pixels."""

    radial: RadialLens
    centre: FloatArray

    @property
    def parameters(self) -> FloatArray:
        """``a1, a2, ..., cx, cy``."""
        return np.concatenate([self.radial.coefficients, self.centre])

    def moved(self, step: FloatArray) -> CentredLens:
        """Return the lens with changed parameters."""
        radial = RadialLens(self.radial.family, self.radial.coefficients + step[:-2])
        return CentredLens(radial, self.centre + step[-2:])


@dataclass(frozen=True, slots=True)
class Bundle:
    """The points of all curves, one after the other.

    Parameters
    ----------
    points : ndarray, shape (P, 2)
        Pixels.
    starts : ndarray of int, shape (L,)
        Index of each curve's first point.
    weights : ndarray, shape (P,)
        Weight of each point; those of a curve add up to at most `max_points`.
    radius : float
        ``S``, half the diagonal, pixels.
    """

    points: FloatArray
    starts: npt.NDArray[np.intp]
    weights: FloatArray
    radius: float

    @classmethod
    def of(cls, curves: Sequence[FloatArray], radius: float, max_points: int) -> Bundle:
        """Concatenate curves."""
        counts = np.array([len(curve) for curve in curves])
        weights = np.repeat(np.minimum(1.0, max_points / counts), counts)
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        return cls(np.concatenate(curves), starts, weights, radius)

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum over the points of each curve."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def per_point(self, values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        """Repeat a curve's value for each of its points."""
        counts = np.diff(np.append(self.starts, len(self.points)))
        return np.asarray(np.repeat(values, counts, axis=0))

    def measure(self, lens: CentredLens) -> Straightness:
        """Fit each curve's line under a lens."""
        q = (self.points - lens.centre) / self.radius
        square = np.einsum("ij,ij->i", q, q)
        divisor, slope, by_coefficients = lens.radial.divisor(square)
        rows = np.column_stack([q, divisor])
        weights = self.weights
        for _ in range(REWEIGHTINGS):
            lines, _ = fit_lines(self.sums(weights[:, None, None] * _outer(rows)))
            point_lines = self.per_point(lines)
            gradients = point_lines[:, :2] + (2 * slope * point_lines[:, 2])[:, None] * q
            norms = np.maximum(np.hypot(gradients[:, 0], gradients[:, 1]), TINY)
            weights = self.weights / norms**2
        residuals = self.radius * np.einsum("ij,ij->i", rows, point_lines) / norms
        rms = np.sqrt(self.sums(self.weights * residuals**2) / self.sums(self.weights))
        return Straightness(self, lines, rows, by_coefficients, norms, gradients, residuals, rms)


@dataclass(frozen=True, slots=True)
class Straightness:
    """Curves under a lens, with their lines.

    Parameters
    ----------
    lines : ndarray, shape (L, 3)
        ``(n, d)`` with ``|n| = 1``, in units of ``S`` about the centre.
    rows : ndarray, shape (P, 3)
        ``(q, D)`` of each point.
    by_coefficients : ndarray, shape (P, C)
        Derivatives of ``D`` by the coefficients.
    norms : ndarray, shape (P,)
        Norms of `gradients`.
    gradients : ndarray, shape (P, 2)
        Gradients of ``n . q + d D`` by ``q``.
    residuals : ndarray, shape (P,)
        Distance of each point from the image of its line, to first order, pixels.
    rms : ndarray, shape (L,)
        Root mean square of each curve's residuals, pixels.
    """

    bundle: Bundle
    lines: FloatArray
    rows: FloatArray
    by_coefficients: FloatArray
    norms: FloatArray
    gradients: FloatArray
    residuals: FloatArray
    rms: FloatArray

    def jacobian(self) -> FloatArray:
        """Return derivatives of the residuals by ``a1, a2, ..., cx, cy``, with the lines refitted.

        The lines are eliminated by projection on what they cannot follow (variable projection, L.
        Kaufman, BIT 15 (1975) 49-57). Changes of the norms are neglected: the residuals are small.
        """
        bundle = self.bundle
        lines = bundle.per_point(self.lines)
        scaled = bundle.radius / self.norms[:, None]
        columns = np.hstack(
            [scaled * lines[:, 2:] * self.by_coefficients, -self.gradients / self.norms[:, None]]
        )
        angle_derivative = lines[:, 1] * self.rows[:, 0] - lines[:, 0] * self.rows[:, 1]
        line_columns = scaled * np.column_stack([angle_derivative, self.rows[:, 2]])
        weighted = bundle.weights[:, None] * line_columns
        information = bundle.sums(weighted[:, :, None] * line_columns[:, None, :])
        information += TINY * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        mixed = bundle.sums(weighted[:, :, None] * columns[:, None, :])
        line_response = bundle.per_point(np.linalg.solve(information, mixed))
        return np.asarray(columns - np.einsum("pi,pij->pj", line_columns, line_response))

    def moments(self) -> FloatArray:
        """Return ``row row^T / |gradient|^2`` summed, (L, 3, 3); those of joined curves add up."""
        weights = self.bundle.weights / self.norms**2
        return self.bundle.sums(weights[:, None, None] * _outer(self.rows))


def fit_lines(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lines ``(n, d)``, ``|n| = 1``, that minimise quadratic forms, and the minima.

    Parameters
    ----------
    moments : ndarray, shape (L, 3, 3)
        Weighted sums of the outer products of rows ``(q, D)``.

    Returns
    -------
    lines : ndarray, shape (L, 3)
    minima : ndarray, shape (L,)
    """
    mixed, last = moments[:, :2, 2], np.maximum(moments[:, 2, 2], TINY)
    reduced = moments[:, :2, :2] - mixed[:, :, None] * mixed[:, None, :] / last[:, None, None]
    xx, xy, yy = reduced[:, 0, 0], reduced[:, 0, 1], reduced[:, 1, 1]
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    normals = np.column_stack([-np.sin(angle), np.cos(angle)])
    offsets = -np.einsum("ij,ij->i", mixed, normals) / last
    lines = np.column_stack([normals, offsets])
    return lines, np.maximum(np.einsum("li,lij,lj->l", lines, moments, lines), 0.0)


def _outer(rows: FloatArray) -> FloatArray:
    return np.asarray(rows[:, :, None] * rows[:, None, :])
