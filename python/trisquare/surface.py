"""The smooth surface that a plane's crossings lie on: a homography, then a lens's bending.

An ideal point lies at `p / (1 + bend |p|^2)` if the photograph has it at p, in half diagonals from
the picture's middle: the division model, which leaves a hundredth of a cell of any usual lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trisquare.grids import Grid
from trisquare.quads import FloatArray

STEPS = 6
"""Gauss-Newton steps, which reweight as well: a few strays have lost their weight by then."""

SETTLED = 0.3
"""Pixels below which deviations weigh the same; the search's own scatter."""

CLOSE = 0.6
"""Pixels: where no crossing is farther off, there are no strays, and a bend is not evident."""

USUAL_BEND = 0.2
MOST_BEND = 0.5
"""Of lenses: a strong barrel distortion has 0.25, a lens of 120 degrees 0.4. A few crossings tell
it no better than that."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Where a plane has the crossings of each row and column.

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
        middle = 0.5 * (np.array(shape[1::-1], dtype=np.float64) - 1.0)
        size = max(float(np.hypot(*middle)), 1.0)
        present = grid.present
        sites = np.argwhere(present)[:, ::-1].astype(np.float64)
        centre = 0.5 * (sites.min(axis=0) + sites.max(axis=0))
        half = np.maximum(sites.max(axis=0) - centre, 1.0)
        homography, bend = _fit(
            (sites - centre) / half, (grid.points[present] - middle) / size, size
        )
        scaling = np.diag([1.0 / half[0], 1.0 / half[1], 1.0])
        scaling[:2, 2] = -centre / half
        return cls(homography @ scaling, bend, middle, size)

    def at(self, sites: FloatArray) -> FloatArray:
        """Points of the photograph, shape (..., 2), for columns and rows; NaN if there is none."""
        mapped = sites @ self.homography[:, :2].T + self.homography[:, 2]
        with np.errstate(invalid="ignore", divide="ignore"):
            # The depth is one in the middle of the crossings.
            ideal = np.where(mapped[..., 2:] > 0.0, mapped[..., :2] / mapped[..., 2:], np.nan)
            bent = 4.0 * self.bend * np.sum(ideal**2, axis=-1, keepdims=True)
            factor = 2.0 / (1.0 + np.sqrt(1.0 - bent))
        return np.asarray(self.middle + self.size * factor * ideal)

    def sites(self, points: FloatArray) -> FloatArray:
        """Columns and rows, shape (N, 2), of points of the photograph; NaN if there are none."""
        observed = (points - self.middle) / self.size
        ideal = observed / (1.0 + self.bend * np.sum(observed**2, axis=1, keepdims=True))
        # A homography without inverse, which noise may give, is solved as nearly as can be.
        right = np.column_stack([ideal, np.ones(len(ideal))]).T
        mapped = np.linalg.lstsq(self.homography, right, rcond=None)[0].T
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(mapped[:, :2] / mapped[:, 2:])

    def deviations(self, grid: Grid) -> FloatArray:
        """How far each crossing is off, pixels, shape (rows, cols); NaN where there is none."""
        rows, cols = np.indices(grid.present.shape, dtype=np.float64)
        gap = np.linalg.norm(grid.points - self.at(np.stack([cols, rows], axis=-1)), axis=2)
        # What has no place on the surface is as far off as can be.
        return np.where(grid.present & ~np.isfinite(gap), self.size, gap)


def _fit(at: FloatArray, points: FloatArray, size: float) -> tuple[FloatArray, float]:
    """Homography and bend that take places, shape (N, 2), to points, by least absolute gaps."""
    homography, bend = _homography(at, points), 0.0
    place = np.column_stack([at, np.ones(len(at))])
    r2 = np.sum(points**2, axis=1)
    rows = np.zeros((len(at), 2, 9))
    for number in range(STEPS):
        mapped = place @ homography.T
        depth = np.where(np.abs(mapped[:, 2]) > 1e-9, mapped[:, 2], 1e-9)
        ideal = mapped[:, :2] / depth[:, None]
        factor = 1.0 / (1.0 + bend * r2)
        gap = size * (ideal - points * factor[:, None])
        off = np.hypot(gap[:, 0], gap[:, 1])
        is_close = off.max() < CLOSE
        if is_close and number != 1:  # with a bend where one was needed at all
            break
        weight = 1.0 / np.maximum(off, CLOSE if is_close else SETTLED)
        rows[:, 0, :3] = rows[:, 1, 3:6] = place * (size / depth)[:, None]
        rows[:, :, 6:8] = ideal[:, :, None] * at[:, None, :] * (-size / depth)[:, None, None]
        rows[:, :, 8] = points * (size * r2 * factor**2)[:, None]
        weighted = (rows * weight[:, None, None]).reshape(-1, 9)
        information = weighted.T @ rows.reshape(-1, 9)
        information[8, 8] += SETTLED / USUAL_BEND**2
        gradient = weighted.T @ gap.ravel()
        gradient[8] += SETTLED / USUAL_BEND**2 * bend
        if not (np.isfinite(information).all() and np.isfinite(gradient).all()):
            break
        step = np.linalg.lstsq(information, -gradient, rcond=None)[0]
        homography = homography + np.append(step[:8], 0.0).reshape(3, 3)
        bend = float(np.clip(bend + step[8], -MOST_BEND, MOST_BEND))
    return homography, bend


def _homography(at: FloatArray, points: FloatArray) -> FloatArray:
    """Homography that fits best in the algebraic sense; its last entry is one."""
    centre, size = points.mean(axis=0), max(float(points.std()), 1e-9)
    scaled = (points - centre) / size
    place = np.column_stack([at, np.ones(len(at))])
    rows = np.zeros((len(at), 2, 9))
    rows[:, 0, :3] = rows[:, 1, 3:6] = place
    rows[:, :, 6:] = -scaled[:, :, None] * place[:, None, :]
    flat = rows.reshape(-1, 9)
    _, vectors = np.linalg.eigh(flat.T @ flat)
    moved = np.array([[size, 0.0, centre[0]], [0.0, size, centre[1]], [0.0, 0.0, 1.0]])
    homography = moved @ vectors[:, 0].reshape(3, 3)
    last = homography[2, 2]
    return np.asarray(homography / (last if abs(last) > 1e-9 else 1e-9))
