"""The smooth surface that a plane's crossings lie on: a homography, then a lens's bending."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.grids import Grid


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Where a plane has the crossings of each row and column.

    An ideal point lies at ``p / (1 + bend |p|^2)`` if the photograph has it at p, in half diagonals
    from the picture's middle: the division model.

    Attributes
    ----------
    homography : ndarray of float64, shape (3, 3)
        From (column, row, 1) to ideal points, in half diagonals from the picture's middle.
    bend : float
    middle : ndarray of float64, shape (2,)
        Of the picture, pixels.
    size : float
        Half its diagonal, pixels.
    """

    homography: FloatArray
    bend: float
    middle: FloatArray
    size: float

    @classmethod
    def of(cls, grid: Grid, shape: tuple[int, ...]) -> Surface:
        """Fit a grid's crossings, but for a few strays.

        Parameters
        ----------
        grid : Grid
            Of four crossings and more that are not on one line.
        shape : tuple of int
            Of the picture that it is in.
        """
        width, height = shape[1::-1]
        middle = 0.5 * (width - 1.0), 0.5 * (height - 1.0)
        size = max(math.hypot(*middle), 1.0)
        homography, bend = _core.fit_lattice_surface(grid.points, middle, size)
        return cls(homography, bend, np.array(middle), size)

    def at(self, sites: FloatArray) -> FloatArray:
        """Points of the photograph, shape (..., 2), for columns and rows; NaN if there is none."""
        points = _core.lattice_surface_points(self.homography, self.bend, sites.reshape(-1, 2))
        return self.middle + self.size * points.reshape(sites.shape)

    def sites(self, points: FloatArray) -> FloatArray:
        """Columns and rows, shape (N, 2), of points of the photograph; NaN if there are none."""
        observed = (points - self.middle) / self.size
        return _core.lattice_surface_sites(self.homography, self.bend, observed)

    def deviations(self, grid: Grid) -> FloatArray:
        """How far each crossing is off, pixels, shape (rows, cols); NaN where there is none."""
        rows, cols = np.indices(grid.present.shape, dtype=np.float64)
        gap = np.linalg.norm(grid.points - self.at(np.stack([cols, rows], axis=-1)), axis=2)
        # What has no place on the surface is as far off as can be.
        return np.where(grid.present & ~np.isfinite(gap), self.size, gap)
