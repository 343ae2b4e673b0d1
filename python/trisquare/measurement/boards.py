"""The edges of a chessboard's grid lines, measured through its crossings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._core import SideSamples
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice
from trisquare.edges import PlaneEdges, unchecked_edges
from trisquare.measurement.board_shift import shift_toward_light, shifts_of_lines, without_shift
from trisquare.measurement.marker_margins import light_cells, marker_rims
from trisquare.measurement.side_spans import SideSpan

PROBE = 0.25
"""Distance from a grid line, in cells, at which a cell's shade is looked up: inside the white rim
of a ChArUco board's marker or on the marker, but for the most part on the light cell."""

LEAST_LINES = 2
"""Grid lines that a plane needs in each direction: three parallel ones of four leave it open."""

FADED = 1.05
"""Standard deviation of a sample, over the least of its cell, from which a crossing takes part of
its contrast, `2 Phi(2) - 1 = 1 / 1.05`, or it lies across one: a wrong tone curve shifts it by
neither cell's amount, but by up to as much more as it is less certain."""

MOST_DOUBT = 1.0
"""Shift, in standard deviations of a sample, from which samples at crossings are left out: what it
may do to them is more than their noise, and goes to and fro with the cells. Below, they are doubted
by as much; to leave them out for less would cost short cells half of what is known of a line."""


class GridLine(NamedTuple):
    """A row or a column of crossings, those only that have a neighbour in it."""

    is_row: bool
    number: int
    """Of the row or column."""
    places: npt.NDArray[np.intp]
    """Of its crossings in it, in order."""


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A chessboard, whole or in part, that was found: see `DetectedTarget`."""

    lattice: Lattice
    contrast_sign: float
    """+1 if a row gets lighter toward its right-hand normal after the very first crossing of the
    lattice, else -1; from cell to cell, and from row to row, it is the opposite."""
    rims: FloatArray | None = None
    """Of the markers in the cells between and around R x C crossings, shape (R + 1, C + 1): the
    distance from their cell's edges over its side; 0 for a cell without one."""
    kind: str = "chessboard"

    @classmethod
    def of(cls, lattice: Lattice, grey: npt.NDArray[np.uint8]) -> Board:
        """Look up in a grey picture which cells are light, and which of them carry a marker."""
        contrast_sign = _contrast_sign(lattice, grey)
        return cls(
            lattice, contrast_sign, marker_rims(grey, lattice, first_is_dark=contrast_sign < 0.0)
        )

    @classmethod
    def of_board(cls, lattice: Lattice, dark_corner: bool, rim: float) -> Board:
        """Know the cells of a ChArUco board from the colour of its first, and its markers' rims."""
        contrast_sign = -1.0 if dark_corner else 1.0
        rows, cols = lattice.present.shape
        light = light_cells((rows + 1, cols + 1), first_is_dark=dark_corner)
        return cls(lattice, contrast_sign, np.where(light, rim, 0.0), "charuco")

    @property
    def quad(self) -> FloatArray:
        """The crossings' bounding rectangle that is smallest, shape (4, 2), pixels."""
        points = self.lattice.crossings[self.lattice.present].astype(np.float32)
        return np.asarray(cv2.boxPoints(cv2.minAreaRect(points)), dtype=np.float64)

    def spans(self, first: int) -> list[SideSpan]:
        """Return the grid lines, the rows before the columns."""
        lines = _grid_lines(self.lattice.present)
        # The span of the row, and of the column, through every crossing.
        through = np.full((2, *self.lattice.present.shape), -1)
        for span, line in enumerate(lines, first):
            rows, cols = _indices(line)
            through[0 if line.is_row else 1, rows, cols] = span
        spans: list[SideSpan] = []
        for line in lines:
            rows, cols = _indices(line)
            others = through[1 if line.is_row else 0, rows, cols].tolist()
            crossings = [
                (other if other >= 0 else None, place)
                for other, place in zip(others, line.places.tolist(), strict=True)
            ]
            path = np.ascontiguousarray(self.lattice.crossings[rows, cols])
            polarity = self._contrast_sign_after_first(line)
            rims = () if self.rims is None else _rims_along(self.rims, line)
            spans.append(SideSpan(path, polarity, crossings=crossings, rims=rims))
        return spans

    def figures(self, measured: Sequence[SideSamples | str], plane: int) -> list[PlaneEdges]:
        """One figure of all grid lines that were measured."""
        return self.figures_and_shift(measured, plane)[0]

    def figures_and_shift(
        self, measured: Sequence[SideSamples | str], plane: int
    ) -> tuple[list[PlaneEdges], float]:
        """Return the figures, and by how much edges were shifted toward the light, pixels."""
        rows, cols = self.lattice.present.shape
        models, lines, clear, doubted = [], [], [], []
        for line, samples in zip(_grid_lines(self.lattice.present), measured, strict=True):
            if isinstance(samples, str):
                continue
            points, std = samples.points, samples.std
            if line.is_row:
                models.append((0.0, 1.0, (rows - 1) / 2 - line.number))
            else:
                models.append((1.0, 0.0, (cols - 1) / 2 - line.number))
            cells, contrast_signs = self._cells_and_contrast_signs(line, points)
            lines.append((points, std, contrast_signs))
            whole = _clear_of_crossings(std, cells)
            clear.append((points[whole], std[whole], contrast_signs[whole]))
            doubted.append(~whole)
        columns = sum(model[0] != 0.0 for model in models)
        if min(columns, len(models) - columns) < LEAST_LINES:
            return [], 0.0
        # The board's own zigzag tells the shift that a tone curve leaves, far better than profiles
        # do: there is no drift to account for.
        shift = shift_toward_light(clear)
        usual = float(np.median(np.concatenate([std for _, std, _ in lines])))
        evident = abs(shift) > MOST_DOUBT * usual
        # It differs from line to line, as the blur across them does.
        shifts = shifts_of_lines(clear, shift, evident=evident)
        if evident:
            lines, deviations = clear, [std for _, std, _ in clear]
        else:
            deviations = [
                _with_doubt(std, at_crossings, shift)
                for (_, std, _), at_crossings in zip(lines, doubted, strict=True)
            ]
        board = unchecked_edges(
            lines=np.array(models),
            points=tuple(
                without_shift(points, signs, own)
                for (points, _, signs), own in zip(lines, shifts, strict=True)
            ),
            std=tuple(deviations),
            plane=plane,
            kind=self.kind,
        )
        return [board], shift

    def _contrast_sign_after_first(self, line: GridLine) -> float:
        """Which way a line gets lighter after the first of its crossings that were found."""
        # A column's right-hand normal points the other way in the row it starts from.
        sign = self.contrast_sign if line.is_row else -self.contrast_sign
        return sign * float(_alternation(line.number + int(line.places[0])))

    def _cells_and_contrast_signs(
        self, line: GridLine, points: FloatArray
    ) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Which of the line's cells a sample is of, and which way the line gets lighter there."""
        path = self.lattice.crossings[_indices(line)]
        along = path[-1] - path[0]
        after = np.searchsorted(path[1:-1] @ along, points @ along)
        flips: FloatArray = _alternation(line.places[after] - line.places[0])
        return after, self._contrast_sign_after_first(line) * flips


def _clear_of_crossings(std: FloatArray, cells: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """Tell which samples of a line have the whole contrast of their cell."""
    least = np.full(cells.max() + 1, np.inf)
    np.minimum.at(least, cells, std)
    whole = std <= FADED * least[cells]
    # Of a line of few samples, these may be too few to be a line.
    return np.asarray(whole if whole.sum() > 1 else np.ones_like(whole))


def _with_doubt(std: FloatArray, at_crossings: npt.NDArray[np.bool_], shift: float) -> FloatArray:
    """Return samples' deviations, with what a shift of the edges adds to those at crossings."""
    usual = float(np.sort(std)[std.size // 2])
    doubt = math.hypot(1.0, shift / usual)
    return np.where(at_crossings, doubt * std, std)


def _grid_lines(present: npt.NDArray[np.bool_]) -> list[GridLine]:
    """Return the rows, then the columns, that have two neighbouring crossings."""
    lines = []
    for is_row, table in ((True, present), (False, present.T)):
        together = table[:, :-1] & table[:, 1:]
        linked = np.zeros_like(table)
        linked[:, :-1] |= together
        linked[:, 1:] |= together
        for number, row in enumerate(linked):
            places = np.flatnonzero(row)
            if places.size:
                lines.append(GridLine(is_row, number, places))
    return lines


def _indices(line: GridLine) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns of a line's crossings."""
    number = np.full_like(line.places, line.number)
    return (number, line.places) if line.is_row else (line.places, number)


def _rims_along(rims: FloatArray, line: GridLine) -> list[float]:
    """Rims in the light cells beside the stretches after a line's crossings."""
    beside = rims if line.is_row else rims.T
    # Of the two cells beside a stretch one is light, and the other has no marker.
    either: list[float] = (beside[line.number] + beside[line.number + 1])[line.places + 1].tolist()
    return either


def _alternation(number: npt.NDArray[np.intp] | int) -> FloatArray:
    return np.asarray(1.0 - 2.0 * (np.asarray(number) % 2))


def _contrast_sign(lattice: Lattice, grey: npt.NDArray[np.uint8]) -> float:
    """Return +1 if the picture gets lighter to the right of row 0 after its crossing 0, else -1.

    All pairs of neighbouring crossings in a row have their say, because a cell may be hidden or
    carry a marker.
    """
    crossings, present = lattice.crossings, lattice.present
    rows, cols = np.nonzero(present[:, :-1] & present[:, 1:])
    start, end = crossings[rows, cols], crossings[rows, cols + 1]
    along = end - start
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) * PROBE
    middle = 0.5 * (start + end)
    probes = np.stack([middle + normal, middle - normal], axis=1).astype(np.float32)
    if not len(probes):
        return 1.0
    shades = cv2.remap(grey, probes[..., 0], probes[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    contrast = (shades[:, 0] - shades[:, 1]) * _alternation(rows + cols)
    return 1.0 if np.sum(contrast) > 0.0 else -1.0
