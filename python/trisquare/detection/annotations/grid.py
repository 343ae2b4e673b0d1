"""Crossings of a chessboard's grid lines as somebody drew them, moved to where they are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.annotations.outlines import refuse_outside
from trisquare.detection.candidates import Lattice

LEAST_CROSSINGS = 3
"""Rows and columns of crossings that a board must have."""

LEAST_CELL = 8.0
"""Pixels between crossings: of a shorter edge nothing is left between the blur of its ends."""

REACH = 8
"""Pixels within which a crossing is looked for: drawn within 5, and the blur of its edges."""

REACH_OF_CELL = 0.35
"""The same over the distance to the nearest crossing, at most, lest that be taken for it."""

SETTLED_REACH = 4
"""Pixels around a crossing in the second round, where it is nearly known."""

PADDING = 5
"""Pixels that OpenCV wants around a window."""

STEPS = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.01)
"""OpenCV's iteration: within this many steps, until one is below so many pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnGrid:
    """A chessboard by its crossings, each within some pixels of its place.

    Attributes
    ----------
    crossings : ndarray of float64, shape (rows, cols, 2)
        Pixels of the photograph as it is stored; any numbers where there is none.
    present : ndarray of bool, shape (rows, cols)
        Which were drawn.
    where : str
        What its file calls it; messages begin with it.
    """

    crossings: FloatArray
    present: NDArray[np.bool_]
    where: str

    def __post_init__(self) -> None:
        rows, cols = self.present.shape
        if min(rows, cols) < LEAST_CROSSINGS:
            raise ValueError(
                f"{self.where} has {rows} x {cols} crossings: a board needs 3 x 3 or more"
            )
        whole = self._cells_drawn()
        if not whole.any():
            raise ValueError(f"{self.where} has no cell with its four crossings")
        if self._shortest() < LEAST_CELL:
            raise ValueError(
                f"{self.where} has crossings {self._shortest():.1f} px apart: they must be "
                f"{LEAST_CELL:.0f} or more"
            )

    @property
    def kind(self) -> str:
        """Return ``"chessboard"``."""
        return "chessboard"

    @property
    def corners(self) -> FloatArray:
        """The smallest rectangle around the crossings, shape (4, 2), pixels."""
        points = self.crossings[self.present].astype(np.float32)
        return np.asarray(cv2.boxPoints(cv2.minAreaRect(points)), dtype=np.float64)

    def check_inside(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError if a crossing lies outside a picture of this width and height."""
        refuse_outside(self.crossings[self.present], image_size, self.where)

    def settled(self, picture: NDArray[np.uint8]) -> Lattice | str:
        """Move the crossings onto those of a grey picture, or say that there are none.

        A crossing that is not where it was drawn is left out.
        """
        drawn = self.crossings[self.present]
        reach = min(REACH, int(REACH_OF_CELL * self._shortest()))
        if min(picture.shape) < 2 * reach + PADDING:
            return f"{self.where}: the picture is too small to look for its crossings"
        # OpenCV refuses points outside the picture, even by half a pixel.
        inside = np.clip(drawn, 0.0, np.array(picture.shape[::-1]) - 1.0)
        points = np.array(inside, dtype=np.float32, order="C").reshape(-1, 1, 2)
        for window in (reach, min(reach, SETTLED_REACH)):
            cv2.cornerSubPix(picture, points, (window, window), (-1, -1), STEPS)
        moved = points[:, 0].astype(np.float64)
        near = np.isfinite(moved).all(axis=1)
        moved[~near] = np.inf
        near &= np.linalg.norm(moved - drawn, axis=1) <= reach
        present = self.present.copy()
        present[self.present] = near
        crossings = self.crossings.copy()
        crossings[self.present] = np.where(near[:, None], moved, drawn)
        if min(present.any(axis=0).sum(), present.any(axis=1).sum()) < LEAST_CROSSINGS:
            return f"{self.where}: no crossings of a chessboard within {reach} px of those drawn"
        if self._turns_left():
            crossings, present = crossings[:, ::-1], present[:, ::-1]
        return Lattice(np.ascontiguousarray(crossings), np.ascontiguousarray(present))

    def _cells_drawn(self) -> NDArray[np.bool_]:
        drawn = self.present
        return np.asarray(drawn[:-1, :-1] & drawn[:-1, 1:] & drawn[1:, :-1] & drawn[1:, 1:])

    def _shortest(self) -> float:
        """Return the shortest distance between neighbours, pixels."""
        distances = []
        for axis in range(2):
            gaps = np.linalg.norm(np.diff(self.crossings, axis=axis), axis=-1)
            first, last = np.delete(self.present, -1, axis), np.delete(self.present, 0, axis)
            distances.append(gaps[first & last])
        return float(np.concatenate(distances).min(initial=np.inf))

    def _turns_left(self) -> bool:
        """Whether columns go anticlockwise from rows on the screen, most cells judging."""
        along = self.crossings[:-1, 1:] - self.crossings[:-1, :-1]
        down = self.crossings[1:, :-1] - self.crossings[:-1, :-1]
        turn = along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]
        return bool(np.median(turn[self._cells_drawn()]) < 0)
