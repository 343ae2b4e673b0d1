"""Chessboard-like lattices of a picture, one per plane.

OpenCV reduces the picture; the core finds the places where its grey levels are curved as at a
saddle, and links them to lattices, from coarse to fine.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare.detection.candidates import Lattice
from trisquare.detection.grey import MIN_PICTURE

MAX_FULL_SIZE = 1000
"""Longer side, in pixels, of a picture that is searched at full size; a larger one is halved once,
which leaves its smallest cells (10 pixels) five pixels. If the halved picture shows crossings that
make no lattice, as the rims of markers fade in it, the full picture is searched as well."""

MIN_REDUCED_SIDE = 100
"""Minimum shorter side, in pixels, of a reduced picture: a board in it has cells of five pixels."""

MIN_SHARE = 0.5
"""Minimum fraction of the crossings of a board of stated size that are seen: fewer may be something
else."""


class LatticeSearch(NamedTuple):
    """Result of a search for lattices."""

    lattices: list[Lattice]  # from the one of most crossings to the one of fewest
    unlinked_crossings: int
    """Number of crossings of edges outside the lattices, in the reduced picture."""


def find_lattices(grey: NDArray[np.uint8]) -> list[Lattice]:
    """Find every lattice of 3 x 3 crossings and more in a grey picture.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)

    Returns
    -------
    list of Lattice
        From the one of most crossings to the one of fewest; empty if there is none.
    """
    return search_lattices(grey).lattices


def search_lattices(grey: NDArray[np.uint8]) -> LatticeSearch:
    """Find lattices as `find_lattices` does, and count the crossings outside them."""
    if min(grey.shape) < MIN_PICTURE:
        return LatticeSearch([], 0)
    found, unlinked_crossings = _core.find_lattices(grey, _pictures(grey))
    return LatticeSearch([_lattice(lattice.crossings) for lattice in found], unlinked_crossings)


def chessboards_among(lattices: Iterable[Lattice], cols: int, rows: int) -> list[Lattice]:
    """Return the lattices that are chessboards with `cols` x `rows` inner corners, in their order.

    At least half of each board's crossings are seen; the rows of a lattice as large as the board
    are the board's rows.
    """
    boards = (_board_of_size(lattice, cols, rows) for lattice in lattices)
    return [board for board in boards if board is not None]


def _board_of_size(lattice: Lattice, cols: int, rows: int) -> Lattice | None:
    """Return a lattice as a board of `cols` x `rows` inner corners, or None if it is not one."""
    height, width = lattice.present.shape
    if np.count_nonzero(lattice.present) < MIN_SHARE * rows * cols:
        return None
    if height <= rows and width <= cols:
        return lattice
    if height <= cols and width <= rows:
        return Lattice(np.rot90(lattice.crossings), np.rot90(lattice.present))
    return None


def _pictures(grey: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the pictures to search, each twice as fine as the one before."""
    picture = grey
    if max(grey.shape) > MAX_FULL_SIZE and min(grey.shape) > MIN_REDUCED_SIDE:
        picture = np.asarray(cv2.pyrDown(grey), dtype=np.uint8)
    pictures = [picture]
    while min(picture.shape) >= 2 * MIN_REDUCED_SIDE:
        picture = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        pictures.append(picture)
    return pictures[::-1]


def _lattice(crossings: NDArray[np.float64]) -> Lattice:
    """Build a lattice from crossings, shape (rows, cols, 2), which are NaN where none was found."""
    present = np.isfinite(crossings[..., 0])
    crossings[~present] = 0.0
    crossings.flags.writeable = present.flags.writeable = False
    return Lattice(crossings, present)
