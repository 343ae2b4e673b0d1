"""Area and intersection of convex quadrilaterals in the plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def quad_areas(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return areas of quadrilaterals, (..., 4, 2): half the cross products of the diagonals."""
    diagonals = quads[..., 2:, :] - quads[..., :2, :]
    first, second = diagonals[..., 0, :], diagonals[..., 1, :]
    return 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def any_meet(quads: Sequence[NDArray[np.float64]]) -> bool:
    """Return whether two of several convex quadrilaterals, (4, 2) each, intersect."""
    return any(not apart(quads[i], quads[j]) for i in range(len(quads)) for j in range(i))


def apart(quad: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two convex quadrilaterals, shape (4, 2), are separated by a side of one."""
    return separated(quad, other) or separated(other, quad)


def separated(quad: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether all of `other` is outside some side of `quad`, in either orientation."""
    along = np.roll(quad, -1, axis=0) - quad
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inward *= np.sign(np.sum((quad.mean(axis=0) - quad) * inward, axis=1))[:, None]
    depth = np.einsum("ik,ijk->ij", inward, other[None] - quad[:, None])
    return bool(np.any(np.all(depth < 0.0, axis=1)))
