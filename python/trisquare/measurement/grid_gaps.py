"""The gap between the tags of an AprilGrid, from measured edges.

Blur moves the corners of slanted tags by a pixel, as much as the gaps of two small grids differ.
Edges between corners do not move. Across a row of tags they lie at 0, 1, 1 + gap, 2 + gap and so
on, in the projection by the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray

MIN_SAMPLES = 2
"""Minimum number of samples of an edge between two crossings, which determine its line."""

MIN_EDGES = 6
"""Minimum number of edges across a row: four parameters of the camera, the gap, and one to
spare."""

MANY_EDGES = 8
"""Number of edges from which the bend of a row by the lens includes a cubic."""

MIN_ROWS = 3
"""Minimum number of rows and columns whose median is the gap."""

FIRST_STEP, STEPS = 0.01, 10
"""First step of the search for the gap, over the tag's side, and number of steps. The step shrinks
to a third once it brackets the optimum."""

MAX_GAP_CHANGE = 0.1
"""Maximum difference from the gap of the corners, over the tag's side."""

USUAL_GAP_STEP = 0.05
USUAL_GAP_ERROR = 0.003
"""A measured gap within the error of a multiple of the usual gap is taken as that multiple."""


class LineSamples(NamedTuple):
    """Edge samples on one grid line."""

    is_row: bool
    number: int  # index of the row or column
    points: FloatArray  # (N, 2), pixels
    cells: NDArray[np.intp]  # (N,) number of the crossing before each sample


def measured_gap(lines: Sequence[LineSamples], gap: float) -> float:
    """Return the gap over the tag's side; `gap`, from the corners, if few edges are seen."""
    gaps: list[float] = []
    for is_row in (True, False):
        parallel_lines = [line for line in lines if line.is_row == is_row]
        for cell in sorted({cell for line in parallel_lines for cell in line.cells.tolist()}):
            numbers, places = _edges_across(parallel_lines, cell)
            fitted = _fitted_gap(numbers, places, gap) if len(numbers) >= MIN_EDGES else None
            if fitted is not None and abs(fitted - gap) < MAX_GAP_CHANGE:
                gaps.append(fitted)
    if len(gaps) < MIN_ROWS:
        return gap
    median = float(np.median(gaps))
    usual = USUAL_GAP_STEP * round(median / USUAL_GAP_STEP)
    return usual if abs(median - usual) < USUAL_GAP_ERROR else median


def _edges_across(lines: Sequence[LineSamples], cell: int) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the lines' numbers, and where a straight line across them meets each, pixels."""
    numbers, middles, directions = [], [], []
    for line in lines:
        points = line.points[line.cells == cell]
        if len(points) >= MIN_SAMPLES:
            numbers.append(line.number)
            middles.append(points.mean(axis=0))
            directions.append(np.linalg.svd(points - middles[-1])[2][0])
    if len(numbers) < MIN_EDGES:
        return np.zeros(0, np.intp), np.zeros(0)
    middle, direction = np.array(middles), np.array(directions)
    centre = middle.mean(axis=0)
    along = np.linalg.svd(middle - centre)[2][0]
    normal = np.array([-along[1], along[0]])
    # From each middle along its own edge to the line across.
    steps = -((middle - centre) @ normal) / (direction @ normal)
    return np.array(numbers), (middle + steps[:, None] * direction - centre) @ along


def _fitted_gap(numbers: NDArray[np.intp], places: FloatArray, gap: float) -> float | None:
    """Return the gap that fits the projected edges best; None if they do not determine it."""
    step = FIRST_STEP
    for _ in range(STEPS):
        lower_cost, cost, upper_cost = (
            _cost(numbers, places, gap + change) for change in (-step, 0.0, step)
        )
        curvature = lower_cost - 2.0 * cost + upper_cost
        if curvature <= 0.0:
            return None
        move = 0.5 * (lower_cost - upper_cost) / curvature
        gap += float(np.clip(move, -2.0, 2.0)) * step
        if abs(move) < 1.0:
            step /= 3.0
    return gap


def _cost(numbers: NDArray[np.intp], places: FloatArray, gap: float) -> float:
    """Return the sum of squared residuals of places to a smoothly bent, projected line."""
    model = numbers // 2 * (1.0 + gap) + numbers % 2
    middle = 0.5 * (model.min() + model.max())
    unit = (model - middle) / (model.max() - middle)
    bends = [unit**power for power in ((2, 3) if len(unit) >= MANY_EDGES else (2,))]
    terms = np.stack([-unit * places, np.ones_like(unit), unit, *bends], axis=1)
    solution = np.linalg.lstsq(terms, places, rcond=None)[0]
    depth = 1.0 + unit * solution[0]
    return float(np.sum(((places - terms @ solution) / depth) ** 2))
