"""Folding of a corner's sheet into three planes at right angles, and its view from the front."""

from __future__ import annotations

import numpy as np

from trisquare._support.arrays import FloatArray

# Directions right, down and into the paper (columns) in the corner's frame, after folding about the
# lines between the upper left face, which stays, and its two neighbours.
FOLDS = np.array(
    [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
        [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    ]
)
# Along this diagonal a camera sees the three faces equally, each tilted by 54.7 degrees.
DIAGONAL = np.ones(3) / np.sqrt(3.0)
RIGHT = np.cross([0.0, 1.0, 0.0], DIAGONAL)
RIGHT /= np.linalg.norm(RIGHT)
# Rotation of a camera that looks along the diagonal; rows are its axes.
LOOK_ALONG_DIAGONAL = np.array([RIGHT, np.cross(DIAGONAL, RIGHT), DIAGONAL])


def seen_from_front(lines: FloatArray, face: int, distance: float) -> FloatArray:
    """Project lines of a face of the folded corner.

    Parameters
    ----------
    lines : ndarray, shape (N, 2, 2)
        Ends of each line, on the sheet, relative to the apex.
    face : int
        Index of the face in the order of the page's figures.
    distance : float
        Distance of the viewer from the apex, along the diagonal, in the unit of the lines.

    Returns
    -------
    ndarray, shape (N, 2, 2)
        Relative to the apex, x right, y down, at the scale of things as far away as the apex.
    """
    seen = lines @ (LOOK_ALONG_DIAGONAL @ FOLDS[face])[:, :2].T
    projected: FloatArray = seen[..., :2] / (1.0 + seen[..., 2:] / distance)
    return projected
