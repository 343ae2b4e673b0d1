"""Arcs that lie on one straight line, across gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.straightening.bundle import CentredLens, Straightness, fit_lines

LARGEST_GAP = 3.0
"""Maximum gap between two arcs of a line, over the shorter one's length."""

MAX_LINE_RMS = 0.6
"""Maximum RMS distance of each arc from the joint line, working pixels: an arc that crosses the
line or lies beside it is farther away."""

MAX_END_DISTANCE = 3.0
"""Maximum distance of an arc's ends from the other one's line, working pixels; as much again for
each length of that line in the width of the gap."""

NARROWEST_DIVISOR = 0.05
"""Minimum divisor of the division model: points seen farther out have no usable ideal position."""


def merged(
    curves: Sequence[FloatArray], straightness: Straightness, lens: CentredLens, pixel: float
) -> list[list[int]]:
    """Return which curves make a line together under a lens, as lists of their indices.

    Parameters
    ----------
    curves : sequence of ndarray, shape (N_i, 2)
        Pixels, each in its order.
    straightness : Straightness
        Straightness of these curves under the lens.
    pixel : float
        Size of a working pixel.
    """
    bundle = straightness.bundle
    groups = _Groups(straightness, MAX_LINE_RMS * pixel)
    ends = _ideal_ends(curves, lens, bundle.radius)
    for first, second in _near_pairs(straightness, ends, lens, pixel):
        groups.join(int(first), int(second))
    return groups.lists()


def _ideal_ends(curves: Sequence[FloatArray], lens: CentredLens, radius: float) -> FloatArray:
    """Return ideal positions of first and last points, shape (L, 2, 2); NaN if there are none."""
    ends = np.array([[curve[0], curve[-1]] for curve in curves])
    q = (ends - lens.centre) / radius
    divisor = lens.radial.divisor(np.einsum("lij,lij->li", q, q).ravel())[0].reshape(-1, 2)
    divisor = np.where(divisor > NARROWEST_DIVISOR, divisor, np.nan)
    return np.asarray(q / divisor[:, :, None])


def _near_pairs(
    straightness: Straightness, ends: FloatArray, lens: CentredLens, pixel: float
) -> npt.NDArray[np.intp]:
    """Return pairs of curves that might be of one line, narrowest gaps first; shape (N, 2)."""
    lines = straightness.lines
    tangents = np.column_stack([-lines[:, 1], lines[:, 0]])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # The ends of every second curve relative to every first one: along its line, and across.
    along = np.einsum("ik,jek->ije", tangents, ends)
    line_ends = np.einsum("ik,iek->ie", tangents, ends)
    low, high = line_ends.min(axis=1), line_ends.max(axis=1)
    gap = np.maximum(along.min(axis=2) - high[:, None], low[:, None] - along.max(axis=2))
    across = np.einsum("ik,jek->ije", lines[:, :2], ends) + lines[:, 2][:, None, None]
    # In the picture a distance is shorter, approximately by the divisor.
    q = np.linalg.norm(ends, axis=2)
    scale = straightness.bundle.radius * _image_scale(q, lens)
    distance = (np.abs(across) * scale[None]).max(axis=2)
    shorter_lengths = np.minimum(lengths[:, None], lengths[None])
    reach = MAX_END_DISTANCE * pixel * (1 + np.maximum(gap, 0) / lengths[:, None])
    # A line beside the first one overlaps it: an echo of the same edge, not a part of the line.
    with np.errstate(invalid="ignore"):
        is_near = (
            (gap <= LARGEST_GAP * shorter_lengths)
            & (gap > -0.2 * shorter_lengths)
            & (distance <= reach)
        )
    is_near &= lengths[:, None] >= lengths[None]
    np.fill_diagonal(is_near, False)
    first, second = np.nonzero(is_near)
    order = np.argsort(gap[first, second] / shorter_lengths[first, second], kind="stable")
    return np.asarray(np.column_stack([first, second])[order])


def _image_scale(ideal_radius: FloatArray, lens: CentredLens) -> FloatArray:
    """Return the approximate length in the picture of a tangential unit at an ideal radius."""
    first = lens.radial.coefficients[0]
    with np.errstate(invalid="ignore"):
        root = np.sqrt(np.maximum(1 - 4 * first * ideal_radius**2, 0.01))
    return np.asarray(2.0 / (1.0 + root))


class _Groups:
    """Curves joined so far; the moments of a group are the sums of its curves'."""

    def __init__(self, straightness: Straightness, max_rms: float) -> None:
        self._moments = straightness.moments()
        self._counts = straightness.bundle.sums(straightness.bundle.weights)
        self._limit = (max_rms / straightness.bundle.radius) ** 2
        self._members = [[i] for i in range(len(self._counts))]
        self._group = list(range(len(self._counts)))

    def join(self, first: int, second: int) -> None:
        """Join the groups of two curves if one line explains them."""
        a, b = self._group[first], self._group[second]
        if a == b:
            return
        members = self._members[a] + self._members[b]
        moments = self._moments[members]
        line, _ = fit_lines(moments.sum(axis=0)[None])
        mean_squares = np.einsum("i,lij,j->l", line[0], moments, line[0]) / self._counts[members]
        if mean_squares.max() > self._limit:
            return
        self._members[a], self._members[b] = members, []
        for member in members:
            self._group[member] = a

    def lists(self) -> list[list[int]]:
        """Return all groups, of one curve or more."""
        return [sorted(members) for members in self._members if members]


def joined(curves: Sequence[FloatArray], groups: Sequence[Sequence[int]]) -> list[FloatArray]:
    """Return the points of each group's curves."""
    return [np.concatenate([curves[i] for i in group]) for group in groups]
