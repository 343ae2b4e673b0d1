"""Four-cornered contours of a picture at many grey levels: where squares may be.

A threshold between figure and ground turns a square into one connected region whatever its sides
look like, so that sides bent by the lens need no special treatment. No single level suits a whole
picture under uneven light; figures are searched for at a dozen, and each is taken from the level
nearest to the middle between its own inside and outside, where shading disturbs it least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas
from trisquare.detection.candidates import MIN_CONTRAST
from trisquare.detection.grey import RANGE_PERCENTILES
from trisquare.detection.sampling import sample

POINTS_PER_SIDE = 32
FRACTIONS = np.linspace(0.0, 1.0, POINTS_PER_SIDE)
"""Number of points per side of an outline, as in the core, and their positions, corner to
corner."""

LEVELS = 14
"""Number of thresholds over the picture's range: one every 18 grey levels or fewer, so that the
lowest contrast searched for (60 before shading) still spans two or three."""

FLAT_STEP = 14
"""Grey levels over 4 pixels in a row or column, below which a pixel is flat; the blurred edge of
a figure that is searched for is steeper, varying light is not."""

MIN_PLATEAU = 16
"""Minimum number of flat pixels, in every second row, that may be a figure or its ground. The
smallest square has 12 pixels a side, 8 of which its edges do not reach: 32 in every second row."""

LEVELS_BETWEEN_PLATEAUS = 3
"""Maximum number of levels kept of a run without a plateau between them: all of them separate the
same figures, and one in three is near enough to the middle of a figure's contrast."""

MIN_SIDE = 12.0
"""Minimum side, in pixels of the searched picture: the ends of a side are lost to the corners'
blur, and a curve needs some ten pixels between them."""

CLEARANCE = 3.5
"""Distance from a contour, pixels, at which the edge's blur has ended; contours are up to 1.5 px
off."""

BORDER = 4
"""Minimum ground between a figure and the picture's border, pixels."""

MIN_EDGE_SHARE = 0.8
"""Minimum fraction of the points tried on a contour that show an edge of the contour's own sign."""

BOX_SLACK = 1.0
"""Margin of the box around an outline, pixels: more than rounding errors."""

SAME_QUAD_PIXELS = 2.5
SAME_QUAD_FRACTION = 0.04
"""Maximum differences between two outlines of one figure, of centres and sizes: pixels plus a
fraction of the side."""


@dataclass(frozen=True, slots=True, eq=False)
class Quads:
    """Closed outlines with four corners, batched.

    Attributes
    ----------
    sides : ndarray of float64, shape (Q, 4, POINTS_PER_SIDE, 2)
        Points in order, clockwise on the screen: side i runs from corner i to corner i + 1, both
        included.
    dark_inside : ndarray of bool, shape (Q,)
        Whether the inside is darker than the outside.
    contrasts : ndarray of float64, shape (Q, 4)
        Step in grey levels across each side, positive.
    seen : ndarray of bool, shape (Q, 4, POINTS_PER_SIDE)
        Where the side's edge is visible; elsewhere something covers it.
    """

    sides: FloatArray
    dark_inside: NDArray[np.bool_]
    contrasts: FloatArray
    seen: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.sides)

    @property
    def corners(self) -> FloatArray:
        """Corners, shape (Q, 4, 2)."""
        return self.sides[:, :, 0]

    @property
    def normals(self) -> FloatArray:
        """Outward unit normals of the sides' chords, shape (Q, 4, 2)."""
        chords = self.sides[:, :, -1] - self.sides[:, :, 0]
        chords /= np.linalg.norm(chords, axis=-1, keepdims=True)
        return np.stack([chords[..., 1], -chords[..., 0]], axis=-1)

    @classmethod
    def rough(cls, sides: FloatArray, dark_inside: NDArray[np.bool_]) -> Quads:
        """Build quads from sides of unknown contrast, all points taken as visible."""
        sides = sides.reshape(-1, 4, POINTS_PER_SIDE, 2)
        return cls(
            sides, dark_inside, np.zeros((len(sides), 4)), np.ones(sides.shape[:3], dtype=bool)
        )

    @property
    def areas(self) -> FloatArray:
        """Areas of the quadrilaterals of the corners, shape (Q,)."""
        return quad_areas(self.corners)

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Quads:
        """Return the quads that a mask or index array selects."""
        return Quads(
            self.sides[keep], self.dark_inside[keep], self.contrasts[keep], self.seen[keep]
        )

    def followed_by(self, others: Quads) -> Quads:
        """Return these quads and then others."""
        return Quads(
            np.concatenate([self.sides, others.sides]),
            np.concatenate([self.dark_inside, others.dark_inside]),
            np.concatenate([self.contrasts, others.contrasts]),
            np.concatenate([self.seen, others.seen]),
        )


def find_quads(picture: NDArray[np.uint8], smooth: NDArray[np.float32]) -> Quads:
    """Find every four-cornered contour of a grey picture, each once.

    Parameters
    ----------
    picture : ndarray of uint8, shape (H, W)
    smooth : ndarray of float32, shape (H, W)
        The same picture, for measuring on it.

    Returns
    -------
    Quads
        Of both polarities, nested ones included, none touching the border; up to about a pixel
        and a half off the edges.
    """
    contours = _core.find_four_sided(picture, _levels(picture), MIN_SIDE, BORDER)
    sides, levels, dark_inside = contours
    return _with_edges(smooth, Quads.rough(sides, dark_inside), levels.astype(np.float64))


def without_repeats(quads: Quads) -> Quads:
    """Keep the first of the quads that show the same outline."""
    sizes = np.sqrt(quads.areas)
    measures = np.column_stack([quads.corners.mean(axis=1), sizes]).T
    dark = quads.dark_inside
    is_repeat = np.zeros(len(quads), dtype=np.bool_)
    for index, size in enumerate(sizes.tolist()):
        if is_repeat[index]:
            continue
        measure, later_measures = measures[:, index, None], measures[:, index + 1 :]
        is_near = np.abs(later_measures - measure) < SAME_QUAD_PIXELS + SAME_QUAD_FRACTION * size
        is_repeat[index + 1 :] |= (
            is_near[0] & is_near[1] & is_near[2] & (dark[index + 1 :] == dark[index])
        )
    return quads.subset(~is_repeat)


def is_among(quad: FloatArray, others: FloatArray) -> bool:
    """Return whether a quad's middle, (4, 2), lies in one of others, (N, 4, 2), or theirs in it."""
    return bool(are_among(quad[None], others)[0])


def are_among(quads: FloatArray, others: FloatArray) -> NDArray[np.bool_]:
    """Return whether each quad's middle, (M, 4, 2), lies in one of others, or theirs in it.

    Only quads near enough, of which there are few, are compared exactly.
    """
    # Column by column: comparing and joining pairs takes several times as long.
    (left, top, right, bottom), (x, y) = _boxes(others), others.mean(axis=1).T
    among = np.zeros(len(quads), dtype=np.bool_)
    for i, (box, middle) in enumerate(zip(_boxes(quads).T, quads.mean(axis=1), strict=True)):
        near = (left <= middle[0]) & (middle[0] <= right) & (top <= middle[1])
        near &= middle[1] <= bottom
        near |= (box[0] <= x) & (x <= box[2]) & (box[1] <= y) & (y <= box[3])
        among[i] = any(one_in_other(quads[i], others[j]) for j in np.flatnonzero(near))
    return among


def overlapping(quads: FloatArray) -> NDArray[np.bool_]:
    """Return which pairs of quads, (Q, 4, 2), `are_among` each other, shape (Q, Q)."""
    (left, top, right, bottom), (x, y) = _boxes(quads), quads.mean(axis=1).T
    near = (left <= x[:, None]) & (x[:, None] <= right)
    near &= (top <= y[:, None]) & (y[:, None] <= bottom)
    found = np.zeros(near.shape, dtype=np.bool_)
    for i, j in np.argwhere(near | near.T).tolist():
        found[i, j] = i == j or one_in_other(quads[i], quads[j])
    return found


def _boxes(outlines: NDArray[np.floating[Any]]) -> FloatArray:
    """Return boxes of outlines, (N, M, 2), with a margin: left, top, right and bottom, (4, N)."""
    low, high = outlines.min(axis=1) - BOX_SLACK, outlines.max(axis=1) + BOX_SLACK
    return np.concatenate([low, high], axis=1).T.copy()


def in_box(outline: NDArray[np.floating[Any]], points: FloatArray) -> NDArray[np.bool_]:
    """Return which points, (N, 2), lie in the box of an outline, shape (M, 2), or in its margin."""
    left, top, right, bottom = _boxes(outline[None])[:, 0]
    x, y = points.T
    return np.asarray((left <= x) & (x <= right) & (top <= y) & (y <= bottom))


def one_in_other(quad: FloatArray, other: FloatArray) -> bool:
    """Return whether the middle of one of two quads, shape (4, 2), lies within the other."""
    return any(
        cv2.pointPolygonTest(one.astype(np.float32), tuple(two.mean(axis=0)), False) >= 0.0
        for one, two in ((quad, other), (other, quad))
    )


def _levels(picture: NDArray[np.uint8]) -> list[int]:
    """Return thresholds over the picture's range that may separate different figures."""
    shares = 100.0 * _histogram(picture[::4]).cumsum() / picture[::4].size
    darkest, brightest = np.searchsorted(shares, RANGE_PERCENTILES)
    levels = darkest + (brightest - darkest) * (np.arange(LEVELS) + 0.5) / LEVELS
    levels = np.unique(levels.astype(np.intp))
    flat_below = _flat_pixels(picture).cumsum()[levels]
    runs = np.split(levels, np.flatnonzero(np.diff(flat_below) >= MIN_PLATEAU) + 1)
    return [int(level) for run in runs for level in _spread(run)]


def _flat_pixels(picture: NDArray[np.uint8]) -> FloatArray:
    """Count the flat pixels of each grey level, in every second row."""
    along = cv2.absdiff(picture[2:-2:2, 4:], picture[2:-2:2, :-4])
    across = cv2.absdiff(picture[4::2, 2:-2], picture[:-4:2, 2:-2])
    flat = cv2.threshold(cv2.max(along, across), FLAT_STEP - 1, 255, cv2.THRESH_BINARY_INV)[1]
    return _histogram(picture[2:-2:2, 2:-2], flat)


def _histogram(picture: NDArray[np.uint8], mask: MatLike | None = None) -> FloatArray:
    """Count the pixels of each of the 256 grey levels."""
    counts = cv2.calcHist([picture], [0], mask, [256], [0.0, 256.0])
    return np.asarray(counts, dtype=np.float64).ravel()


def _spread(run: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return at most `LEVELS_BETWEEN_PLATEAUS` of a run of levels, evenly spread over it."""
    kept = min(len(run), LEVELS_BETWEEN_PLATEAUS)
    return run[((np.arange(kept) + 0.5) * len(run) / kept).astype(np.intp)]


def _with_edges(smooth: NDArray[np.float32], quads: Quads, levels: FloatArray) -> Quads:
    """Keep quads with an edge of their own sign on all sides, each from its best level."""
    lengths = np.linalg.norm(quads.sides[:, :, -1] - quads.sides[:, :, 0], axis=-1)
    is_long_enough = lengths.min(axis=1, initial=np.inf) >= MIN_SIDE
    quads, levels = quads.subset(is_long_enough), levels[is_long_enough]
    step = CLEARANCE * quads.normals[:, :, None]
    points = quads.sides[:, :, POINTS_PER_SIDE // 8 :: POINTS_PER_SIDE // 4]
    outside, inside = sample(smooth, points + step), sample(smooth, points - step)
    sign = np.where(quads.dark_inside, 1.0, -1.0)[:, None, None]
    steps = sign * (outside - inside)
    has_edges = (steps >= MIN_CONTRAST).mean(axis=(1, 2)) >= MIN_EDGE_SHARE
    contrasts = steps.mean(axis=2)
    middle = 0.5 * (outside + inside).mean(axis=(1, 2))
    with np.errstate(divide="ignore"):
        off_middle = np.abs(levels - middle) / np.abs(contrasts.mean(axis=1))
    order = np.argsort(off_middle, kind="stable")
    order = order[has_edges[order]]
    return without_repeats(replace(quads, contrasts=contrasts).subset(order))
