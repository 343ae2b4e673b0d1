"""Detection of the targets in a picture: every target once, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.annotations.outlines import AnnotatedSquare
from trisquare.detection.annotations.rectangles import taken_as_rectangles
from trisquare.detection.annotations.snap import snap_to_edges
from trisquare.detection.boards.find import chessboards_among, find_lattices, search_lattices
from trisquare.detection.boards.membership import belongs_to, whole_cells
from trisquare.detection.candidates import MIN_CONTRAST, SQUARES_NEEDED, Lattice
from trisquare.detection.grey import (
    RANGE_PERCENTILES,
    grey_bytes,
    grey_bytes_and_range,
    working_picture,
)
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sheets.aprilgrids import MIN_CROSSINGS
from trisquare.detection.sheets.find import SheetMatch, find_sheets, find_unknown_grids
from trisquare.detection.squares.find import find_plain_rectangles, find_squares
from trisquare.images.pixels import Image
from trisquare.measurement.boards import Board
from trisquare.measurement.sheets import Sheet
from trisquare.measurement.side_spans import DetectedTarget
from trisquare.measurement.squares import Square
from trisquare.results.rejected import Rejected

MIN_COMB_RATIO = 1.2
"""Ratio of the difference of neighbouring rows to that of rows two apart, above which a picture
shows two moments in alternate rows. In a picture of one moment the latter differ more, in mere
noise as much. With fields 5 to 10 pixels apart the ratio was 1.6 to 4.5, in pictures of one moment
at most 0.98."""

NEAR_LEVELS = 64
"""Grey levels from black or white up to which a picture without contrast is called nearly that."""


class Search(NamedTuple):
    """A search of a picture and its results.

    `picture` is grey; `scale` pixels of the photograph make one of it, or None if it has yet to be
    reduced and smoothed, as the search for squares does. `levels` are those of the photograph at 0
    and 255 of the picture, white being 255.
    """

    picture: NDArray[np.uint8]
    kinds: TargetKinds
    found: Sequence[DetectedTarget | Rejected]
    scale: int | None = None
    levels: tuple[float, float] = (0.0, 255.0)

    @property
    def targets(self) -> list[DetectedTarget]:
        """The targets that were found."""
        return [target for target in self.found if not isinstance(target, Rejected)]

    def working_picture(self) -> tuple[NDArray[np.uint8], int]:
        """Return the smaller picture that squares are searched in, and its scale."""
        return working_picture(self.picture) if self.scale is None else (self.picture, self.scale)

    def lack_of_contrast(self) -> str:
        """Describe the lack of contrast of a photograph with hardly any; else return nothing."""
        levels = np.percentile(self.working_picture()[0], RANGE_PERCENTILES)
        darkest, brightest = np.interp(levels, (0.0, 255.0), self.levels)
        if brightest - darkest >= MIN_CONTRAST:
            return ""
        shade = (
            "black"
            if brightest < NEAR_LEVELS
            else "white"
            if darkest > 255 - NEAR_LEVELS
            else "uniform"
        )
        grey = f"with grey levels from {darkest:.0f} to {brightest:.0f} of 255"
        return f"the picture is nearly {shade}, {grey}"

    def is_interlaced(self) -> bool:
        """Return whether the rows show two moments in turn, between which much has moved."""
        # Reduction mixes the rows; in a mosaic of colours the columns differ as well.
        return self.scale is None and _is_combed(self.picture) and not _is_combed(self.picture.T)

    def reduced(self) -> Search:
        """Return this search with its smaller picture only, to be kept."""
        picture, scale = self.working_picture()
        return self._replace(picture=picture, scale=scale)


def search(picture: Image, kinds: TargetKinds) -> Search:
    """Search a checked picture for targets."""
    grey, levels = grey_bytes_and_range(picture)
    return Search(grey, kinds, _find_targets(grey, kinds), levels=levels)


def _is_combed(grey: NDArray[np.uint8]) -> bool:
    """Return whether neighbouring rows differ more than those two apart, and not in gain alone."""
    if len(grey) < 3:
        return False
    rows = grey.astype(np.float32)
    rows[1::2] *= rows[::2].mean() / max(float(rows[1::2].mean()), 1.0)
    next_difference, second_difference = (
        cv2.norm(rows[distance:], rows[:-distance], cv2.NORM_L1) / (len(rows) - distance)
        for distance in (1, 2)
    )
    return bool(next_difference > MIN_COMB_RATIO * second_difference)


def _find_targets(
    grey: NDArray[np.uint8], targets: TargetKinds
) -> Sequence[DetectedTarget | Rejected]:
    """Find the targets in a grey picture, and rejected candidates; the list may be empty."""
    if targets.layout is not None:
        return [_detected_target(found) for found in find_sheets(grey, targets.layout)]
    if targets.board is not None:
        return _boards_of_size(grey, targets.board)
    if targets.rectangles is not None:
        return [Square(found) for found in find_plain_rectangles(grey, targets.rectangles)]
    lattices: list[Lattice] = []
    may_be_grids = targets.grids
    if targets.lattices:
        lattices, unlinked_crossings = search_lattices(grey)
        may_be_grids = may_be_grids and unlinked_crossings >= MIN_CROSSINGS
    boards = [Board.of(lattice, grey) for lattice in lattices]
    remaining = _painted_over(grey, lattices)
    grids = (
        [_detected_target(grid) for grid in find_unknown_grids(remaining)] if may_be_grids else []
    )
    grid_lattices = [found.lattice for found in grids if isinstance(found, Board)]
    remaining = _painted_over(remaining, grid_lattices)
    return [*boards, *grids, *_other_squares(remaining, [*lattices, *grid_lattices], targets)]


def _boards_of_size(
    grey: NDArray[np.uint8], size: tuple[int, int]
) -> Sequence[DetectedTarget | Rejected]:
    """Find the boards of a stated size; if there is none, reject those of other sizes."""
    lattices = find_lattices(grey)
    if boards := chessboards_among(lattices, *size):
        return [Board.of(board, grey) for board in boards]
    other_boards = [Board.of(lattice, grey) for lattice in lattices]
    return [
        Rejected(board.kind, 0, board.quad, _size_text(board.lattice)) for board in other_boards
    ]


def _size_text(lattice: Lattice) -> str:
    rows, cols = sorted(lattice.present.shape)
    return f"{cols} x {rows} of its inner corners are seen"


def _detected_target(found: SheetMatch | Rejected) -> DetectedTarget | Rejected:
    """Choose how a sheet that was found is measured."""
    if isinstance(found, Rejected):
        return found
    return Board.of_grid(found) if found.sheet.is_touching else Sheet.of(found)


def _other_squares(
    grey: NDArray[np.uint8], lattices: Sequence[Lattice], targets: TargetKinds
) -> list[DetectedTarget]:
    """Find squares and tags that are not part of a lattice: not cells, nor the sheet it is on."""

    def is_part(corners: FloatArray) -> bool:
        return any(belongs_to(lattice, corners) for lattice in lattices)

    return [
        Square(square)
        for square in find_squares(grey, targets.tags, SQUARES_NEEDED - len(lattices), is_part)
        if (targets.squares or square.tag is not None) and not is_part(square.outer.corners)
    ]


def _painted_over(grey: NDArray[np.uint8], lattices: Sequence[Lattice]) -> NDArray[np.uint8]:
    """Paint over the cells of lattices, which spares further searches thousands of contours."""
    if lattices:
        grey = grey.copy()
    for lattice in lattices:
        _paint(grey, np.rint(whole_cells(lattice)).astype(np.int32))
    return grey


def _paint(grey: NDArray[np.uint8], cells: NDArray[np.int32]) -> None:
    """Fill quads, corners of shape (M, 4, 2), with their mean level."""
    if not len(cells):
        return
    left, top, width, height = cv2.boundingRect(cells.reshape(-1, 2))
    left, top = max(left, 0), max(top, 0)
    part = grey[top : top + height, left : left + width]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(mask, list(cells - np.array([left, top], np.int32)), (255.0,))
    part[mask > 0] = np.rint(cv2.mean(part, mask)[0])


def search_annotated(
    picture: Image, annotated: Sequence[AnnotatedSquare], kinds: TargetKinds
) -> Search:
    """Snap annotated squares to the edges of a checked picture, or reject those without edges.

    If `kinds` names rectangles, they are taken as such.

    Raises
    ------
    ValueError
        If `kinds` names boards, for which outlines do not suffice.
    """
    if annotated and (kinds.board or kinds.layout):
        raise ValueError(
            "outlines are for squares and rectangles, but targets names a board, which is "
            "searched for: leave out one of the two"
        )
    grey = grey_bytes(picture)
    snapped = [snap_to_edges(grey, target) for target in annotated]
    if kinds.rectangles is not None:
        snapped = taken_as_rectangles(snapped, (grey.shape[1], grey.shape[0]), kinds.rectangles)
    found = [
        Rejected(target.kind, 0, target.corners, outline)
        if isinstance(outline, str)
        else Square(outline)
        for target, outline in zip(annotated, snapped, strict=True)
    ]
    # No kinds: with outlines drawn by hand, no shapes were rejected by a search.
    return Search(grey, TargetKinds(), found)
