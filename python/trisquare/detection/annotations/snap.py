"""Snap a hand-drawn outline to the edges of the photograph, to within a pixel.

A drawn outline is some pixels off, and straight where the lens bends a side. Along every side the
picture is sampled across the drawn line. Of all gently curved paths that begin and end near that
line, the one with the strongest mean step is taken: the measurement of edges starts from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import NORMAL_MEDIAN, FloatArray
from trisquare.detection.annotations.outlines import AnnotatedOutline, AnnotatedSquare
from trisquare.detection.candidates import Outline, SquareOutline
from trisquare.detection.sampling import sample
from trisquare.detection.squares.framed import alignment

REACH = 8.0
"""Distance across a drawn line, pixels, within which its edge is searched: an error of 5, and some
more where two ends are off in opposite directions or a corner is drawn past its place."""

REACH_SHARE = 1.0 / 400.0
"""The same over the picture's longer side: a large photograph is drawn on at reduced size, where
the same hand movement is more of its pixels."""

MAX_SIDE_SHARE = 0.25
"""Maximum of the same over a side's length, so that the opposite side is out of reach."""

MAX_BULGE = 0.05
"""Maximum bend of a side from the drawn line, over its chord: strong lenses bend one by 4 %."""

POSITIONS = 48
"""Number of positions along a side at which the picture is sampled across it."""

FILTER_WIDTH = 4
"""Number of pixels averaged on each side of an edge: wider than the blur of a fairly defocused
picture, and narrow enough to separate the outlines of a frame."""

END_TRIALS = 17
BULGE_TRIALS = 41
"""Numbers of offsets tried for each end of a side, and for its sagitta: a pixel or two apart at
first."""

REFINEMENTS = 2
"""Number of refinements, each of which tries the best path's neighbours at half the distance: half
a pixel is finer than the filter resolves."""

DISTANCE_PENALTY = 0.4
"""Relative reduction of a step's score at the end of the reach: of two equally strong edges, the
nearer to the drawn line is the one that was meant."""

MIN_STEP = 4.0
"""Mean step over a whole side, grey levels of 255, below which there is no edge."""

MIN_STEP_NOISES = 1.5
"""The same over the typical step between the pixels around: for the best of ten thousand paths
through mere noise it is below one."""

FARTHEST_CORNER = 4.0
"""Maximum distance, in reaches, from a drawn corner to where the snapped sides meet: at an acute
corner it is more than one."""

END_POSITIONS = 6
"""Number of positions over which a side's direction at its end is measured, an eighth of it."""

MIN_SINE = 0.2
"""Minimum sine of the angle between two sides: at less than 12 degrees a square cannot be
measured."""

PATH_POINTS = 32
"""Number of points of a snapped side."""


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """Steps of the picture across one drawn side, on a grid of positions and offsets."""

    points: FloatArray  # (POSITIONS, 2), on the drawn line
    outward: FloatArray  # (2,), unit
    along: FloatArray  # (POSITIONS,), 0 to 1 over the whole side
    steps: FloatArray  # (POSITIONS, 2 N + 1), outside - inside, at -N to N pixels outward
    reach: float
    needed_step: float


def snap_to_edges(picture: NDArray[np.uint8], annotated: AnnotatedSquare) -> SquareOutline | str:
    """Move a drawn square or frame onto the edges of a picture.

    Parameters
    ----------
    picture : ndarray of uint8, shape (H, W)
    annotated : AnnotatedSquare
        Inside the picture.

    Returns
    -------
    SquareOutline or str
        Within a pixel or two of the edges; or a message that names the side without an edge.
    """
    outer = _snapped_outline(picture, annotated.outer)
    if isinstance(outer, str) or annotated.inner is None:
        return outer if isinstance(outer, str) else SquareOutline(outer, None)
    inner = _snapped_outline(picture, annotated.inner)
    if isinstance(inner, str):
        return inner
    places = alignment(inner.corners, outer.corners)
    return SquareOutline(outer, Outline.of(np.array(inner.sides), inner.dark_inside, places))


@dataclass(frozen=True, slots=True)
class _Path:
    """A curved path along a side: pixels outward of the drawn line at its ends, and its sagitta."""

    first: float
    last: float
    sagitta: float
    step: float
    """Mean step of the picture across it."""
    score: float
    """The same, reduced where the path is far from the drawn line."""

    def offsets(self, along: FloatArray) -> FloatArray:
        """Pixels outward at positions from 0 to 1."""
        straight = self.first + (self.last - self.first) * along
        return np.asarray(straight + 4.0 * self.sagitta * along * (1.0 - along))


def _snapped_outline(picture: NDArray[np.uint8], annotated: AnnotatedOutline) -> Outline | str:
    sides = [_read_side(picture, side) for side in annotated.sides]
    # On all sides of an outline, the inside is darker than the outside, or on all it is lighter.
    light, dark = ([_best_path(side, sign) for side in sides] for sign in (-1.0, 1.0))
    dark_inside = sum(path.score for path in dark) > sum(path.score for path in light)
    paths = dark if dark_inside else light
    for number, (side, path) in enumerate(zip(sides, paths, strict=True)):
        if path.step < side.needed_step:
            start, end = annotated.sides[number][0], annotated.sides[number][-1]
            return (
                f"{annotated.where}: no edge within {side.reach:.0f} px of its side {number}, "
                f"from ({start[0]:.0f}, {start[1]:.0f}) to ({end[0]:.0f}, {end[1]:.0f})"
            )
    curves = [
        side.points + path.offsets(side.along)[:, None] * side.outward
        for side, path in zip(sides, paths, strict=True)
    ]
    corners = [_intersection(curves[i - 1], curves[i]) for i in range(4)]
    for number, corner in enumerate(corners):
        farthest = FARTHEST_CORNER * sides[number].reach
        if corner is None or np.hypot(*(corner - annotated.corners[number])) > farthest:
            x, y = annotated.corners[number]
            return f"{annotated.where}: the edges do not meet near its corner ({x:.0f}, {y:.0f})"
    corner_points = np.array(corners)
    paths_through = [
        np.vstack([corner_points[i], curves[i], corner_points[(i + 1) % 4]]) for i in range(4)
    ]
    shares = np.linspace(0.0, 1.0, PATH_POINTS)
    return Outline.of(
        np.array([_points_at(path, shares) for path in paths_through]), bool(dark_inside)
    )


def _read_side(picture: NDArray[np.uint8], polyline: FloatArray) -> _Side:
    """Read the steps across a drawn side; the picture is continued beyond its border."""
    length = float(np.hypot(*(polyline[-1] - polyline[0])))
    reach = max(REACH, REACH_SHARE * max(picture.shape))
    reach = min(reach, MAX_SIDE_SHARE * length)
    # Near the ends, the steps of the neighbouring sides are in reach as well.
    margin = min(reach / length, MAX_SIDE_SHARE)
    along = np.linspace(margin, 1.0 - margin, POSITIONS)
    points = _points_at(polyline, along)
    chord = (polyline[-1] - polyline[0]) / length
    outward = np.array([chord[1], -chord[0]])
    farthest = int(np.ceil(reach + MAX_BULGE * length))
    pixels = np.arange(-farthest - FILTER_WIDTH, farthest + FILTER_WIDTH + 1, dtype=np.float64)
    values = sample(picture, points[:, None] + pixels[:, None] * outward)
    sums = np.cumsum(np.pad(values, ((0, 0), (1, 0))), axis=1)
    means = (
        sums[:, FILTER_WIDTH:] - sums[:, :-FILTER_WIDTH]
    ) / FILTER_WIDTH  # of the pixels from each on
    steps = means[:, FILTER_WIDTH + 1 :] - means[:, : -FILTER_WIDTH - 1]
    needed = max(MIN_STEP, MIN_STEP_NOISES * float(np.median(np.abs(steps))) / NORMAL_MEDIAN)
    return _Side(points, outward, along, steps, reach, needed)


def _best_path(side: _Side, sign: float) -> _Path:
    """Find the path with the strongest step of one sign, on a grid that is refined around it."""
    steps = sign * side.steps
    # A short piece of far higher contrast must not outweigh an edge along the whole side.
    strongest = max(float(np.median(steps.max(axis=1))), 0.0)
    steps = np.clip(steps, -strongest, strongest)
    middle = side.steps.shape[1] // 2
    max_bulge = middle - side.reach
    best = _Path(0.0, 0.0, 0.0, -np.inf, -np.inf)
    spacing = np.array(
        [2.0 * side.reach / (END_TRIALS - 1)] * 2 + [2.0 * max_bulge / (BULGE_TRIALS - 1)]
    )
    counts = (END_TRIALS // 2, END_TRIALS // 2, BULGE_TRIALS // 2)
    for _ in range(1 + REFINEMENTS):
        ranges = [
            centre + step * np.arange(-count, count + 1)
            for centre, step, count in zip(
                (best.first, best.last, best.sagitta), spacing, counts, strict=True
            )
        ]
        first, last, sagitta = (grid.ravel() for grid in np.meshgrid(*ranges, indexing="ij"))
        is_in_reach = (np.maximum(np.abs(first), np.abs(last)) <= side.reach) & (
            np.abs(sagitta) <= max_bulge
        )
        first, last, sagitta = first[is_in_reach], last[is_in_reach], sagitta[is_in_reach]
        along = side.along[:, None]
        offsets = first * (1.0 - along) + last * along + 4.0 * sagitta * along * (1.0 - along)
        index = np.rint(offsets).astype(np.intp) + middle
        step = np.take_along_axis(steps, index, axis=1).mean(axis=0)
        relative_offset = np.maximum(
            np.maximum(np.abs(first), np.abs(last)) / side.reach, np.abs(sagitta) / max_bulge
        )
        score = step * (1.0 - DISTANCE_PENALTY * relative_offset)
        best_index = int(score.argmax())
        if score[best_index] > best.score:
            best = _Path(
                *(float(value[best_index]) for value in (first, last, sagitta, step, score))
            )
        spacing, counts = 0.5 * spacing, (2, 2, 2)
    return best


def _intersection(before: FloatArray, after: FloatArray) -> FloatArray | None:
    """Return where the straight continuations of one side's end and the next one's start meet."""
    end_direction, start_direction = (
        before[-1] - before[-END_POSITIONS],
        after[0] - after[END_POSITIONS - 1],
    )
    cross = end_direction[0] * start_direction[1] - end_direction[1] * start_direction[0]
    if abs(cross) < MIN_SINE * np.hypot(*end_direction) * np.hypot(*start_direction):
        return None
    gap = after[0] - before[-1]
    return np.asarray(
        before[-1]
        + (gap[0] * start_direction[1] - gap[1] * start_direction[0]) / cross * end_direction
    )


def _points_at(polyline: FloatArray, shares: FloatArray) -> FloatArray:
    """Return points of a polyline at fractions of its length."""
    arc_lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(polyline, axis=0).T)))
    places = shares * arc_lengths[-1]
    return np.stack(
        [np.interp(places, arc_lengths, polyline[:, axis]) for axis in range(2)], axis=1
    )
