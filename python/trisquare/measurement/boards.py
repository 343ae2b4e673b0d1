"""The edges of a chessboard's grid lines, measured through its crossings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice
from trisquare.detection.sampling import box_around, sample
from trisquare.detection.sheets.find import SheetMatch
from trisquare.edges import PlaneEdges, unchecked_edges
from trisquare.measurement.grid_gaps import LineSamples, measured_gap
from trisquare.measurement.marker_margins import light_cells, marker_rims
from trisquare.measurement.side_spans import SideSpan

PROBES = np.array([0.12, 0.25, 0.4])
"""Distances from a grid line, in cells, at which a cell's shade is sampled: a dark cell is dark at
all of them, and the black border of a ChArUco board's marker covers one or two."""

MIN_LINES = 2
"""Minimum number of grid lines of a plane in each direction: four lines of which three are parallel
do not determine a plane."""


class GridLine(NamedTuple):
    """A row or a column of crossings: those that have a neighbour in it."""

    is_row: bool
    number: int
    """Index of the row or column."""
    places: npt.NDArray[np.intp]
    """Indices of its crossings in it, in order."""

    @property
    def indices(self) -> tuple[int | npt.NDArray[np.intp], ...]:
        """Rows and columns of its crossings."""
        return (self.number, self.places) if self.is_row else (self.places, self.number)


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A chessboard, whole or in part, that was found: a `DetectedTarget`."""

    lattice: Lattice
    contrast_sign: float
    """+1 if a row gets lighter toward its right-hand normal after the very first crossing of the
    lattice, else -1; the sign alternates from cell to cell, and from row to row."""
    rims: FloatArray | None = None
    """Distance of the markers in the cells between and around R x C crossings from their cell's
    edges, over its side, shape (R + 1, C + 1); 0 for a cell without a marker."""
    kind: str = "chessboard"
    lines: tuple[FloatArray, FloatArray] | None = None
    """Positions of the rows and of the columns, sheet coordinates; by default one apart."""
    tags: npt.NDArray[np.bool_] | None = None
    """For a grid of tags, by their row and column, which cells within the border are light, in rows
    from the top, shape (R / 2, C / 2, n, n)."""
    tag_border: float = 0.0
    """Width of the tags' border over their side."""
    gap: float | None = None
    """For a grid of tags whose layout is not stated, the gap from its corners, over the tags' side;
    the measured edges give it more accurately."""

    @classmethod
    def of(cls, lattice: Lattice, grey: npt.NDArray[np.uint8]) -> Board:
        """Look up in a grey picture which cells are light, and which of them carry a marker."""
        contrast_sign = _contrast_sign(lattice, grey)
        return cls(
            lattice, contrast_sign, marker_rims(grey, lattice, first_is_dark=contrast_sign < 0.0)
        )

    @classmethod
    def of_board(cls, lattice: Lattice, dark_corner: bool, rim: float) -> Board:
        """Build a ChArUco board from the colour of its first cell, and its markers' rims."""
        contrast_sign = -1.0 if dark_corner else 1.0
        rows, cols = lattice.present.shape
        light = light_cells((rows + 1, cols + 1), first_is_dark=dark_corner)
        return cls(lattice, contrast_sign, np.where(light, rim, 0.0), "charuco")

    @classmethod
    def of_grid(cls, grid: SheetMatch) -> Board:
        """Take the tags' sides for grid lines: at a tag's corner they continue along dark squares.

        Dark and light alternate as on a chessboard, with cells of two widths.
        """
        gap = grid.sheet.gap
        first = grid.model[:, 0]
        places = np.rint((first - first.min(axis=0)) / (1.0 + gap)).astype(int)
        across, down = 2 * (places.max(axis=0) + 1)
        crossings = np.zeros((down, across, 2))
        present = np.zeros((down, across), bool)
        tags = np.zeros((int(down) // 2, int(across) // 2, *grid.cells.shape[1:]), dtype=np.bool_)
        tags[places[:, 1], places[:, 0]] = grid.cells
        for (x, y), corners in zip(places.tolist(), grid.corners, strict=True):
            for corner, (right, below) in zip(
                corners, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True
            ):
                crossings[2 * y + below, 2 * x + right] = corner
                present[2 * y + below, 2 * x + right] = True
        return cls(
            Lattice(crossings, present),
            -1.0,
            kind=grid.sheet.kind,
            lines=(_side_positions(down, gap), _side_positions(across, gap)),
            tags=tags,
            tag_border=grid.border,
            gap=None if grid.sheet.is_stated else gap,
        )

    @property
    def quad(self) -> FloatArray:
        """Smallest bounding rectangle of the crossings, shape (4, 2), pixels."""
        return box_around(self.lattice.crossings[self.lattice.present])

    def spans(self, first: int) -> list[SideSpan]:
        """Return the spans of the grid lines, the rows before the columns."""
        lines = _grid_lines(self.lattice.present)
        # For every crossing, the spans of the row and of the column through it.
        span_numbers = np.full((2, *self.lattice.present.shape), -1)
        for span, line in enumerate(lines, first):
            span_numbers[(0 if line.is_row else 1, *line.indices)] = span
        spans: list[SideSpan] = []
        for line in lines:
            crossing_spans = span_numbers[(1 if line.is_row else 0, *line.indices)].tolist()
            crossings = [
                (crossing_span if crossing_span >= 0 else None, place)
                for crossing_span, place in zip(crossing_spans, line.places.tolist(), strict=True)
            ]
            path = np.ascontiguousarray(self.lattice.crossings[line.indices])
            polarity = self._even_contrast_sign(line) * (-1.0) ** int(line.places[0])
            rims = () if self.rims is None else _rims_along(self.rims, line)
            spans.append(
                SideSpan(
                    path,
                    polarity,
                    crossings=crossings,
                    rims=rims,
                    tags=self._tags_along(line),
                    tag_border=self.tag_border,
                )
            )
        return spans

    def figures(self, measured: Sequence[_core.SideSamples | str], plane: int) -> list[PlaneEdges]:
        """Return one figure of all grid lines that were measured."""
        return self.figures_and_shift(measured, plane)[0]

    def figures_and_shift(
        self, measured: Sequence[_core.SideSamples | str], plane: int
    ) -> tuple[list[PlaneEdges], float]:
        """Return the figures, and by how much edges were shifted toward the light, pixels."""
        measured_lines, lines = [], []
        for line, samples in zip(_grid_lines(self.lattice.present), measured, strict=True):
            if isinstance(samples, str):
                continue
            measured_lines.append(line)
            beside = self._cells(line, samples.points)
            lines.append((samples.points, samples.std, beside, self._even_contrast_sign(line)))
        row_count = sum(line.is_row for line in measured_lines)
        if min(row_count, len(measured_lines) - row_count) < MIN_LINES:
            return [], 0.0
        # The zigzag of the board's own lines gives the shift that a tone curve leaves, far more
        # accurately than profiles do: no drift is left.
        unshifted_lines, shift = _core.remove_edge_shift(lines)
        points, deviations, cells = zip(*unshifted_lines, strict=True)
        down, across = self._line_positions(
            [
                LineSamples(line.is_row, line.number, *samples)
                for line, *samples in zip(measured_lines, points, cells, strict=True)
            ]
        )
        models = [
            (0.0, 1.0, -down[line.number]) if line.is_row else (1.0, 0.0, -across[line.number])
            for line in measured_lines
        ]
        board = unchecked_edges(
            lines=np.array(models), points=points, std=deviations, plane=plane, kind=self.kind
        )
        return [board], shift

    def _line_positions(self, lines: Sequence[LineSamples]) -> tuple[FloatArray, FloatArray]:
        """Return the positions of the rows and of the columns, sheet coordinates."""
        down, across = self.lattice.present.shape
        if self.gap is not None:
            gap = measured_gap(lines, self.gap)
            return _side_positions(down, gap), _side_positions(across, gap)
        return self.lines or (
            np.arange(down) - 0.5 * (down - 1),
            np.arange(across) - 0.5 * (across - 1),
        )

    def _tags_along(self, line: GridLine) -> list[list[list[bool]]]:
        """Return the cells of the tags beside the stretches after a line's crossings."""
        if self.tags is None:
            return []
        # Oriented as beside a row, from the left and from the top.
        tags_by_row = self.tags if line.is_row else self.tags.transpose(1, 0, 3, 2)
        tags = tags_by_row[line.number // 2]
        if line.number % 2:
            tags = tags[:, ::-1]
        return [
            tags[place // 2].tolist() if place % 2 == 0 else [] for place in line.places.tolist()
        ]

    def _even_contrast_sign(self, line: GridLine) -> float:
        """Return in which direction, +1 or -1, a line gets lighter after its even crossings."""
        # A column's right-hand normal points the other way in the row it starts from.
        sign = self.contrast_sign if line.is_row else -self.contrast_sign
        return sign * (-1.0) ** line.number

    def _cells(self, line: GridLine, points: FloatArray) -> npt.NDArray[np.intp]:
        """Return the number of the crossing in whose cell, after it, each sample of a line is."""
        path = self.lattice.crossings[line.indices]
        along = path[-1] - path[0]
        return np.asarray(line.places[np.searchsorted(path[1:-1] @ along, points @ along)])


def _side_positions(count: int, gap: float) -> FloatArray:
    """Return positions of tags' sides in a row: pairs one apart, about their common middle."""
    numbers = np.arange(count)
    places = numbers // 2 * (1.0 + gap) + numbers % 2
    return np.asarray(places - 0.5 * places[-1])


def _grid_lines(present: npt.NDArray[np.bool_]) -> list[GridLine]:
    """Return the rows, then the columns, that have two neighbouring crossings."""
    lines = []
    for is_row, table in ((True, present), (False, present.T)):
        has_next = table[:, :-1] & table[:, 1:]
        has_neighbour = np.zeros_like(table)
        has_neighbour[:, :-1] |= has_next
        has_neighbour[:, 1:] |= has_next
        for number, row in enumerate(has_neighbour):
            (places,) = row.nonzero()
            if places.size:
                lines.append(GridLine(is_row, number, places))
    return lines


def _rims_along(rims: FloatArray, line: GridLine) -> list[float]:
    """Return the rims in the light cells beside the stretches after a line's crossings."""
    rims_by_line = rims if line.is_row else rims.T
    # One of the two cells beside a stretch is light, and the other has no marker.
    stretch_rims: list[float] = (rims_by_line[line.number] + rims_by_line[line.number + 1])[
        line.places + 1
    ].tolist()
    return stretch_rims


def _contrast_sign(lattice: Lattice, grey: npt.NDArray[np.uint8]) -> float:
    """Return +1 if the picture gets lighter to the right of row 0 after its crossing 0, else -1.

    All pairs of neighbouring crossings in a row contribute, because a cell may be hidden or carry a
    marker.
    """
    crossings, present = lattice.crossings, lattice.present
    rows, cols = np.nonzero(present[:, :-1] & present[:, 1:])
    start, end = crossings[rows, cols], crossings[rows, cols + 1]
    along = end - start
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) * PROBES[:, None, None]
    middle = 0.5 * (start + end)
    contrast = sample(grey, middle + normal) - sample(grey, middle - normal)
    contrast *= (-1.0) ** (rows + cols)
    return 1.0 if np.sum(contrast) >= 0.0 else -1.0
