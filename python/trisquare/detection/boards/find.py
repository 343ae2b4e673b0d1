"""Chessboard-like lattices of a picture, one per plane.

OpenCV reduces the picture; the core finds where its grey levels are curved as at a saddle, and
links those places to lattices, from coarse to fine.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare.detection.candidates import Lattice
from trisquare.detection.grey import MIN_PICTURE, grey_bytes

FINEST = 1000
"""Longest side in pixels of a picture that is searched as it is; a larger one is halved once,
which leaves its smallest cells (10 pixels) five pixels. Where that shows crossings which make no
lattice, as the rims of markers fade in it, the whole is searched as well."""

COARSEST = 100
"""Shortest side in pixels of the coarsest picture: a board in it has cells of five pixels."""

LEAST_SHARE = 0.5
"""Of the crossings of a board of stated size, that must be seen: fewer may be something else."""


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
    return [_lattice(found.crossings) for found in _core.find_lattices(grey, _pictures(grey))]


def find_chessboards(image: NDArray[np.generic], cols: int, rows: int) -> list[Lattice]:
    """Find the chessboards with `cols` x `rows` inner corners.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR.
    cols, rows : int
        Inner corners along the board's two directions.

    Returns
    -------
    list of Lattice
        From the one of which most is seen to the one of which least. Of each at least half of the
        crossings are seen; its rows run along the board's where it is as large as the board. Empty
        if the picture shows no such board.
    """
    grey = grey_bytes(image)
    if min(grey.shape) < MIN_PICTURE:
        return []
    found = []
    for lattice in find_lattices(grey):
        height, width = lattice.present.shape
        if np.count_nonzero(lattice.present) < LEAST_SHARE * rows * cols:
            continue
        if height <= rows and width <= cols:
            found.append(lattice)
        elif height <= cols and width <= rows:
            found.append(Lattice(np.rot90(lattice.crossings), np.rot90(lattice.present)))
    return found


def _pictures(grey: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Pictures to search, each twice as fine as the one before."""
    picture = grey
    if max(grey.shape) > FINEST and min(grey.shape) > COARSEST:
        picture = np.asarray(cv2.pyrDown(grey), dtype=np.uint8)
    pictures = [picture]
    while min(picture.shape) >= 2 * COARSEST:
        picture = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        pictures.append(picture)
    return pictures[::-1]


def _lattice(crossings: NDArray[np.float64]) -> Lattice:
    """Tell crossings that were found, shape (rows, cols, 2), from those that are NaN."""
    present = np.isfinite(crossings[..., 0])
    crossings[~present] = 0.0
    crossings.flags.writeable = present.flags.writeable = False
    return Lattice(crossings, present)
