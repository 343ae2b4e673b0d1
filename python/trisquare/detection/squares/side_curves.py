"""Smooth curved sides through rough quads, measured on the grey picture itself.

Contour pixels lie up to a pixel beside the edge and jump with the noise. A cubic through the
edge positions along a side removes both, and tells apart what only looks four-cornered at one
threshold: its edge is not there, or has the wrong sign, or is no smooth curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import MIN_CONTRAST
from trisquare.detection.sampling import sample
from trisquare.detection.squares.notched_quads import FRACTIONS
from trisquare.detection.squares.quads import Quads, without_repeats

END_MARGIN_PIXELS = 3.0
END_MARGIN_FRACTIONS = (0.06, 0.25)
"""Left out at each end of a side, where two edges blend; as a fraction it is kept within bounds."""

PROFILE = np.arange(-3.0, 4.0)
"""Offsets across the edge, pixels along the outward normal."""

ROUNDS = 3
"""A contour may miss the edge by more than the profile sees near a corner; each round follows
the edge further there."""

SETTLED = 0.1
"""Pixels; a round that moved no curve further than this is the last."""

MIN_RELATIVE_CONTRAST = 0.4
"""Of a side's median contrast, that an edge point must have."""

MAX_RESIDUAL = 0.75
"""Pixels from the curve to the edge, beyond which a point does not belong to it."""

MIN_INLIERS = 0.85
"""Share of a side's points that must lie on its curve, with the side's own contrast ..."""

MIN_INLIERS_HIDDEN = 0.65
"""... and of the one side, if any, that a finger, glare or a tear may hide a quarter of, with the
blur at both ends."""

MAX_SAGITTA = 0.16
"""Over the chord: a fisheye bends a long side by 15 %, a quarter circle has 0.21."""

MAX_CORNER_COSINE = np.cos(np.deg2rad(25.0))
"""Corners between 25 and 155 degrees: beyond, the square is seen too flat to measure."""

MAX_CORNER_SHIFT = 0.25
"""Over the chord, from the rough corner to where the sides really meet."""

LEAST_CROSS = 1e-3
"""Squared pixels; two sides so parallel do not meet, and are refused by their angle."""

NEWTON_STEPS = 3
"""Two almost straight curves meet in two."""


def fit_sides(
    picture: NDArray[np.float32],
    quads: Quads,
    least_inliers: tuple[float, float] = (MIN_INLIERS, MIN_INLIERS_HIDDEN),
) -> Quads:
    """Measure the quads' sides and keep the quads whose four sides are smooth edges.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        Rough, within about a pixel and a half of the edge; in order of preference.
    least_inliers : (float, float)
        Share of a side's points that must lie on its curve, and of the weakest side's.

    Returns
    -------
    Quads
        Within a few tenths of a pixel of the edge, each outline once.
    """
    if len(quads) == 0:
        return quads
    chords = _Chords.between(quads.corners, np.roll(quads.corners, -1, axis=1))
    sign = np.where(quads.dark_inside, 1.0, -1.0)[:, None, None]
    along = chords.inner_positions(FRACTIONS)
    rough_along, offset = chords.coordinates(quads.sides)
    off_corners = (rough_along > along[..., :1]) & (rough_along < along[..., -1:])
    cubic = _cubics(_powers(rough_along), offset, off_corners, chords.lengths, trimmed=True)
    basis = _powers(along)
    curve = _evaluate(cubic, basis)
    for _ in range(ROUNDS):
        offset = curve
        step, contrast = _measure_edge(picture, chords, along, offset)
        contrast *= sign
        typical = np.median(contrast, axis=2, keepdims=True)
        sharp = contrast > MIN_RELATIVE_CONTRAST * np.maximum(typical, MIN_CONTRAST)
        measured = offset + step
        cubic = _cubics(basis, measured, sharp, chords.lengths, trimmed=True)
        on_curve = sharp & (np.abs(measured - _evaluate(cubic, basis)) < MAX_RESIDUAL)
        cubic = _cubics(basis, measured, on_curve, chords.lengths, trimmed=False)
        curve = _evaluate(cubic, basis)
        if np.abs(curve - offset).max() < SETTLED:
            break

    first, last, cosines = _meet(chords, cubic)
    positions = first[..., None] + (last - first)[..., None] * FRACTIONS
    offsets = _evaluate(cubic, _powers(positions))
    sagitta = np.abs(offsets - 0.5 * (offsets[..., :1] + offsets[..., -1:])).max(axis=2)
    inliers = on_curve.mean(axis=2)
    weakest = np.arange(4) == inliers.argmin(axis=1)[:, None]
    good = (
        (inliers >= np.where(weakest, least_inliers[1], least_inliers[0]))
        & (typical[..., 0] >= MIN_CONTRAST)
        & (sagitta <= MAX_SAGITTA * chords.lengths)
        & (np.abs(cosines) <= MAX_CORNER_COSINE)
        & (np.abs(first) < MAX_CORNER_SHIFT)
        & (np.abs(last - 1.0) < MAX_CORNER_SHIFT)
    ).all(axis=1)
    # The final sides' points lie within a margin of those that were measured.
    seen = on_curve | ~weakest[..., None]
    fitted = Quads(chords.points(positions, offsets), quads.dark_inside, typical[..., 0], seen)
    return without_repeats(fitted.subset(good))


@dataclass(frozen=True, slots=True, eq=False)
class _Chords:
    """Frames along the chords of sides: position 0 to 1 along, offset in pixels outward."""

    starts: FloatArray  # (Q, 4, 2)
    directions: FloatArray  # (Q, 4, 2), unit
    outward: FloatArray  # (Q, 4, 2), unit
    lengths: FloatArray  # (Q, 4)

    @classmethod
    def between(cls, starts: FloatArray, ends: FloatArray) -> _Chords:
        """Frames of quads whose corners go clockwise on the screen."""
        lengths = np.linalg.norm(ends - starts, axis=-1)
        directions = (ends - starts) / lengths[..., None]
        outward = np.stack([directions[..., 1], -directions[..., 0]], axis=-1)
        return cls(starts, directions, outward, lengths)

    def rolled(self) -> _Chords:
        """For each side, the chord of the side before."""
        fields = (self.starts, self.directions, self.outward, self.lengths)
        starts, directions, outward, lengths = (np.roll(field, 1, axis=1) for field in fields)
        return _Chords(starts, directions, outward, lengths)

    def coordinates(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and offset of points (Q, 4, N, 2)."""
        relative = points - self.starts[:, :, None]
        along = np.einsum("qsni,qsi->qsn", relative, self.directions) / self.lengths[..., None]
        return along, np.einsum("qsni,qsi->qsn", relative, self.outward)

    def points(self, along: FloatArray, offset: FloatArray) -> FloatArray:
        """Points (Q, 4, N, 2) from positions and offsets (Q, 4, N)."""
        forward = along * self.lengths[..., None]
        points = np.empty((*along.shape, 2))
        for axis in range(2):
            points[..., axis] = forward * self.directions[:, :, None, axis]
            points[..., axis] += offset * self.outward[:, :, None, axis]
            points[..., axis] += self.starts[:, :, None, axis]
        return points

    def inner_positions(self, fractions: FloatArray) -> FloatArray:
        """Spread positions (Q, 4, N) over the chords without the ends."""
        margin = np.clip(END_MARGIN_PIXELS / self.lengths, *END_MARGIN_FRACTIONS)[..., None]
        return margin + (1.0 - 2.0 * margin) * fractions


def _powers(along: FloatArray) -> FloatArray:
    """Cubic basis about the middle of the chord, shape (..., 4)."""
    basis = np.ones((*along.shape, 4))
    basis[..., 1] = centred = 2.0 * along - 1.0
    basis[..., 2] = squared = centred * centred
    basis[..., 3] = centred * squared
    return basis


def _cubics(
    basis: FloatArray,
    offset: FloatArray,
    used: NDArray[np.bool_],
    lengths: FloatArray,
    *,
    trimmed: bool,
) -> FloatArray:
    """Least squares of offset on position, shapes (Q, 4, N, 4), (Q, 4, N), (Q, 4) -> (Q, 4, 4).

    Those `trimmed` are without the points that stray from what most of a side's points say.
    """
    count = basis.shape[2]
    cubics = _core.fit_side_cubics(
        basis.reshape(-1, count, 4),
        offset.reshape(-1, count),
        used.reshape(-1, count),
        lengths.ravel(),
        trimmed,
    )
    return cubics.reshape(*lengths.shape, 4)


def _evaluate(cubic: FloatArray, basis: FloatArray) -> FloatArray:
    """Offsets (Q, 4, N) of the cubics at positions of the given basis (Q, 4, N, 4)."""
    return np.asarray((basis @ cubic[..., None])[..., 0], dtype=np.float64)


def _slope(cubic: FloatArray, along: FloatArray) -> FloatArray:
    """Change of offset per unit of position, both (Q, 4)."""
    centred = 2.0 * along - 1.0
    derivative = cubic[..., 1] + 2.0 * cubic[..., 2] * centred + 3.0 * cubic[..., 3] * centred**2
    return 2.0 * derivative


def _measure_edge(
    picture: NDArray[np.float32], chords: _Chords, along: FloatArray, offset: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where the edge is, outward from the curve in pixels, and its step outside - inside.

    The profile's sum counts how many of its pixels are on the outer side; unlike a steepest
    gradient this is unbiased by noise and needs no interpolation.
    """
    count = len(PROFILE)
    spread = (offset[..., None] + PROFILE).reshape(*offset.shape[:2], -1)
    points = chords.points(np.repeat(along, count, axis=-1), spread)
    profile = sample(picture, points).reshape(*offset.shape, count)
    inside, outside = profile[..., :2].mean(axis=-1), profile[..., -2:].mean(axis=-1)
    contrast = outside - inside
    usable = np.where(np.abs(contrast) < 1.0, 1.0, contrast)
    outer_share = np.clip((profile - inside[..., None]) / usable[..., None], -0.25, 1.25)
    return count / 2.0 - outer_share.sum(axis=-1), contrast


def _meet(chords: _Chords, cubic: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions where each side meets the one before and the one after, and the corners' cosines.

    Newton's method on the two positions, from the ends of the chords; shapes (Q, 4). The cosine
    is that between the directions of a side and the one before, at their common corner.
    """
    shape = chords.lengths.shape
    first, last = np.zeros(shape), np.ones(shape)  # on side i; on side i - 1
    before, cubic_before = chords.rolled(), np.roll(cubic, 1, axis=1)
    for _ in range(NEWTON_STEPS):
        gap = _point_at(before, cubic_before, last) - _point_at(chords, cubic, first)
        here, there = _tangent(chords, cubic, first), _tangent(before, cubic_before, last)
        cross = there[..., 0] * here[..., 1] - there[..., 1] * here[..., 0]
        cross = np.where(np.abs(cross) < LEAST_CROSS, LEAST_CROSS, cross)
        # last * there - first * here = -gap, by Cramer's rule.
        last = last - (gap[..., 0] * here[..., 1] - gap[..., 1] * here[..., 0]) / cross
        first = first - (gap[..., 0] * there[..., 1] - gap[..., 1] * there[..., 0]) / cross
        first, last = np.clip(first, -0.5, 0.5), np.clip(last, 0.5, 1.5)
    lengths = np.linalg.norm(here, axis=-1) * np.linalg.norm(there, axis=-1)
    cosines = (here * there).sum(axis=-1) / lengths
    return first, np.roll(last, -1, axis=1), cosines


def _point_at(chords: _Chords, cubic: FloatArray, along: FloatArray) -> FloatArray:
    """Points (Q, 4, 2) of the curves at positions (Q, 4)."""
    positions = along[..., None]
    return chords.points(positions, _evaluate(cubic, _powers(positions)))[:, :, 0]


def _tangent(chords: _Chords, cubic: FloatArray, along: FloatArray) -> FloatArray:
    """Differentiate the curves' points by position, shape (Q, 4, 2)."""
    forward = chords.lengths[..., None] * chords.directions
    return forward + _slope(cubic, along)[..., None] * chords.outward
