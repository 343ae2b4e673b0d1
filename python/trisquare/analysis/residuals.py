"""The measured sides of a picture with their residuals, for drawings and plots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.results.calibration import Calibration


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredSide:
    """One measured line of a figure with the signed distances of its samples to the model.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        The samples, in pixels.
    residuals : ndarray, shape (N,)
        Signed distance of each sample from the line's image, in pixels, positive along `normals`.
    normals : ndarray, shape (N, 2)
        Unit normal of the line's image at each sample.
    plane : int
        Index of the calibration's plane that it lies on.
    """

    points: FloatArray
    residuals: FloatArray
    normals: FloatArray
    plane: int

    @property
    def curve(self) -> FloatArray:
        """Points of the line's image at the samples, in order along it, shape (N, 2)."""
        feet = self.points - self.residuals[:, None] * self.normals
        centred = feet - feet.mean(axis=0)
        direction = np.linalg.eigh(centred.T @ centred)[1][:, 1]
        return np.asarray(feet[np.argsort(centred @ direction, kind="stable")])


def measured_sides(calibration: Calibration, image: int = 0) -> Iterator[MeasuredSide]:
    """Yield the measured sides of one picture; none if the result has no edges."""
    for figure, own in zip(calibration.edges, calibration.residuals, strict=True):
        if figure.image == image:
            for points, distances, normals in zip(
                figure.points, own.distances, own.normals, strict=True
            ):
                yield MeasuredSide(points, distances, normals, own.plane)
