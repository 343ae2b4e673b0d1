"""The edges of a sheet of known layout: its markers' borders, and a ChArUco board's grid lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trisquare._core import SideSamples
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice
from trisquare.detection.sampling import box_around
from trisquare.detection.sheets.find import SheetMatch
from trisquare.edges import PlaneEdges, unchecked_edges
from trisquare.measurement.boards import Board
from trisquare.measurement.marker_margins import side_margins
from trisquare.measurement.marker_shift import marker_shift
from trisquare.measurement.side_spans import SideSpan

MIN_MARGIN = 3.0
"""Minimum margins of a marker's edge, pixels. With less between a chessboard's edges and the
marker's own bits, it is off by some hundredths of a pixel, and the grid lines suffice without
it."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A sheet of known layout that was found: a `DetectedTarget`.

    Attributes
    ----------
    kind : str
        ``"charuco"`` or ``"sheet"``.
    model : ndarray, shape (N, 4, 2)
        Corners of the markers that were found, sheet coordinates.
    corners : ndarray, shape (N, 4, 2)
        The same in the picture, coarse, pixels.
    lattice : Board or None
        The chessboard round the markers, if there is one.
    border, gap : float
        Widths of the markers' black border and of the white round it, over their side.
    """

    kind: str
    model: FloatArray
    corners: FloatArray
    lattice: Board | None
    border: float
    gap: float

    @classmethod
    def of(cls, match: SheetMatch) -> Sheet:
        """Add the chessboard, if the sheet has one, to the markers that were found."""
        sheet, dark_corner = match.sheet, match.arrangement.dark_corner
        lattice = None
        if sheet.squares is not None and dark_corner is not None:
            crossings = _crossings(sheet.squares, match.model, match.corners)
            lattice = Board.of_board(crossings, dark_corner, sheet.rim)
        return cls(sheet.kind, match.model, match.corners, lattice, match.border, sheet.gap)

    @property
    def quad(self) -> FloatArray:
        """Smallest bounding rectangle of all markers, shape (4, 2), pixels."""
        return box_around(self.corners)

    def spans(self, first: int) -> list[SideSpan]:
        """Return the spans of the grid lines, then four for each marker."""
        spans = [] if self.lattice is None else self.lattice.spans(first)
        for corners in self.corners:
            number = first + len(spans)
            margins = side_margins(corners, self.border, self.gap)
            spans += [
                SideSpan(
                    corners[[i, (i + 1) % 4]],
                    -1.0,
                    (number + (i + 3) % 4, number + (i + 1) % 4),
                    margins[i],
                )
                for i in range(4)
            ]
        return spans

    def figures(self, measured: Sequence[SideSamples | str], plane: int) -> list[PlaneEdges]:
        """Return one figure of the grid lines and one for each marker, all in sheet coordinates."""
        grid = len(measured) - 4 * len(self.corners)
        markers = []
        for index, model in enumerate(self.model):
            sides = measured[grid + 4 * index : grid + 4 * index + 4]
            samples = [side for side in sides if not isinstance(side, str)]
            if len(samples) == 4:
                markers.append((index, model, samples))
        figures: list[PlaneEdges] = []
        if self.lattice is not None:
            figures, shift = self.lattice.figures_and_shift(measured[:grid], plane)
        if figures:
            markers = [marker for marker in markers if self._has_margins(marker[0])]
            # A tone curve shifts markers differently from crossed lines, which the joint fit
            # accounts for.
            if any(side.drift is not None for _, _, sides in markers for side in sides):
                shift = 0.0
        else:
            models = np.array([model for _, model, _ in markers])
            shift = marker_shift(
                models, [[side.points for side in sides] for _, _, sides in markers]
            )
        for _, model, samples in markers:
            side = float(np.linalg.norm(model[1] - model[0]))
            border = self.border * side
            figures.append(_marker_edges(model, samples, shift, plane, self.kind, border))
        return figures

    def _has_margins(self, marker: int) -> bool:
        """Return whether a marker's edges have the minimum margins, to the board and its bits."""
        margins = side_margins(self.corners[marker], self.border, self.gap)
        return min(min(sides) for sides in margins) >= MIN_MARGIN


def _marker_edges(
    model: FloatArray,
    samples: list[SideSamples],
    shift: float,
    plane: int,
    kind: str,
    border: float,
) -> PlaneEdges:
    """Return the edges of one marker, corrected for the shift that is common to the sheet."""
    along = np.roll(model, -1, axis=0) - model
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    offsets = -(inward * model).sum(axis=1)
    # If the shift was measured on the sheet itself, no drift is left.
    drift = tuple(side.drift for side in samples if side.drift is not None and shift == 0.0)
    return unchecked_edges(
        lines=np.column_stack([inward, offsets]),
        points=tuple(_moved_inward(side.points, shift) for side in samples),
        std=tuple(side.std for side in samples),
        polarity=1,
        plane=plane,
        kind=kind,
        freedom="fixed",
        drift=drift or None,
        border=border,
    )


def _moved_inward(points: FloatArray, shift: float) -> FloatArray:
    """Move the samples of one side of a marker, in clockwise order, into it by the shift."""
    x, y = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    return np.asarray(points + shift * np.array([-y, x]))


def _crossings(squares: tuple[int, int], model: FloatArray, corners: FloatArray) -> Lattice:
    """Return the coarse crossings beside the markers.

    They are mapped by a homography, and moved as the markers' nearest corners are, to follow the
    lens's distortion and bent paper.
    """
    cols, rows = squares
    x, y = np.meshgrid(np.arange(1, cols) - cols / 2, np.arange(1, rows) - rows / 2)
    grid = np.stack([x, y], axis=-1)
    moved = np.zeros((*grid.shape[:2], 2))
    count = np.zeros(grid.shape[:2])
    homography, _ = cv2.findHomography(model.reshape(-1, 2), corners.reshape(-1, 2))
    shifts = corners - cv2.perspectiveTransform(model.reshape(1, -1, 2), homography).reshape(
        corners.shape
    )
    for marker, shift in zip(model, shifts, strict=True):
        # The four crossings round a marker are its corners, moved outward.
        outward = np.sign(marker - marker.mean(axis=0))
        places = np.rint(marker.mean(axis=0) + 0.5 * outward + [cols / 2 - 1, rows / 2 - 1])
        for (column, row), step in zip(places.astype(int).tolist(), shift, strict=True):
            if 0 <= column < cols - 1 and 0 <= row < rows - 1:
                moved[row, column] += step
                count[row, column] += 1.0
    seen = cv2.perspectiveTransform(grid.reshape(1, -1, 2), homography).reshape(grid.shape)
    is_present = count > 0.0
    crossings = np.where(
        is_present[..., None], seen + moved / np.maximum(count, 1.0)[..., None], 0.0
    )
    return Lattice(crossings, is_present)
