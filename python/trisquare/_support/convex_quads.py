"""Convex quadrilaterals in the plane: their area, and whether they meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def quad_areas(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Areas of quadrilaterals, shape (..., 4, 2), half the cross product of their diagonals."""
    diagonals = quads[..., 2:, :] - quads[..., :2, :]
    first, second = diagonals[..., 0, :], diagonals[..., 1, :]
    return 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def any_meet(quads: Sequence[NDArray[np.float64]]) -> bool:
    """Whether two of several convex quadrilaterals, (4, 2) each, meet."""
    return any(not apart(quads[i], quads[j]) for i in range(len(quads)) for j in range(i))


def apart(quad: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether two convex quadrilaterals, shape (4, 2), have a side of one between them."""
    return separated(quad, other) or separated(other, quad)


def separated(quad: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether some side of `quad`, going round it either way, has all of `other` outside."""
    along = np.roll(quad, -1, axis=0) - quad
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inward *= np.sign(np.sum((quad.mean(axis=0) - quad) * inward, axis=1))[:, None]
    depth = np.einsum("ik,ijk->ij", inward, other[None] - quad[:, None])
    return bool(np.any(np.all(depth < 0.0, axis=1)))
