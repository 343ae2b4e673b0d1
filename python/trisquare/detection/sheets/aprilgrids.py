"""Kalibr AprilGrids: from a few decoded tags, along the grid, to all that are there.

Tags with borders of two cells touch small dark squares at their corners, so that a threshold
separates few whole outlines. But a tag determines where its neighbours are, and the corners are
saddles, which are located without a threshold.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.sampling import homographies_from_unit_square
from trisquare.detection.sheets.layout import GRID_GAPS, UNIT_SQUARE
from trisquare.detection.sheets.smooth_surface import MIN_POINTS, SmoothSurface
from trisquare.detection.tags.codes import dictionary
from trisquare.detection.tags.decode import WIDE_BORDER, agreement
from trisquare.detection.tags.families import WIDE_BORDERED
from trisquare.detection.tags.find import shortest_side
from trisquare.detection.tags.touching import find_touching_tags, on_saddles

MIN_TAGS = 3
"""Minimum number of tags of a grid: two may still stand side by side by chance."""

MIN_CROSSINGS = 4 * MIN_TAGS
"""Minimum number of crossings in a picture of a grid: those at the corners of its tags. The cells
within make more: where grids of four tags were found, there were 34 and more."""

MIN_AGREEMENT = 0.6
"""Minimum correlation between the cells of a tag and those of the expected code. Any other code of
the dictionary correlates to less than 0.4."""

NEAREST_TAGS = 6
"""Number of tags of a grid that predict the next one's place: they are close enough for any
lens."""

SURROUNDING_TAGS = 9
"""Number of tags of a grid, itself included, that predict a tag's place."""

MIN_PROJECTIVE = 0.75
"""Minimum fraction of their corners that fit a homography where the lens does not bend them."""

MIN_ROBUST = 3
"""Minimum number of tags for a robust fit, which identifies the wrong corners among theirs."""

MAX_OFF_SURFACE = 0.06
"""Maximum distance of a corner from where the tags around predict it, over the tag's shortest side.
At a slanted, blurred tag, something else than its corner may look more like a saddle."""

MAX_OFF_AXIS = 0.15
"""Maximum apparent distance of a neighbour from its row, over a tag's side, if it is small and
blurred."""

USUAL_GAP_STEP = 0.05
USUAL_GAP_ERROR = 0.01
"""A gap within the error of a multiple of the usual gap is taken as that multiple."""


class GridTag(NamedTuple):
    """A tag on a grid; its place is the column and the row relative to the first one read."""

    number: int
    place: tuple[int, int]
    corners: FloatArray  # (4, 2), pixels, clockwise from the top left of the grid


class AprilGrid(NamedTuple):
    """Tags of one grid."""

    tags: list[GridTag]
    gap: float  # over the tags' side
    border: float  # likewise
    cells: NDArray[np.bool_]
    """Which cells within the tags' borders are light, shape (N, n, n), rows from the grid's top."""

    @property
    def model(self) -> FloatArray:
        """Corners of the tags, their side as unit, shape (N, 4, 2)."""
        return _model([tag.place for tag in self.tags], self.gap)


class Print(NamedTuple):
    """Properties that all grids of a picture have in common."""

    cols: int | None  # None where only one row is seen
    gap: float
    turns: int  # quarter turns of the code relative to the grid
    row_step: int  # rows down to the tag above in number: -1, as Kalibr counts, or 1
    last: int | None  # numbers modulo columns of the last column, if it is seen

    def ends_row(self, number: int) -> bool:
        """Return whether the next number is on another row."""
        return self.cols is not None and self.last == number % self.cols


class Pair(NamedTuple):
    """Two tags side by side, by their indices; the second has the higher number."""

    first: int
    second: int
    number: int  # that of the first tag
    number_step: int  # number of the second less that of the first
    turn: int  # quarter turns clockwise from the right of the first one's code to the second one
    gap: float  # between them, over their side


Steps: TypeAlias = "dict[int, list[tuple[int, int, int]]]"
"""For a tag's index, those of the tags beside it, with the columns and rows to them."""


def find_aprilgrids(grey: NDArray[np.uint8], name: str = WIDE_BORDERED) -> list[AprilGrid]:
    """Find every grid of tags with wide borders in a grey picture.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    name : str
        The tags' dictionary.

    Returns
    -------
    list of AprilGrid
        From the one of most tags to the one of fewest.
    """
    numbers, corners = find_touching_tags(grey, name)
    if len(numbers) < MIN_TAGS:
        return []
    pairs = list(_pairs(numbers, corners))
    printed = _print(pairs)
    if printed is None:
        return []
    border = WIDE_BORDER / (dictionary(name).side + 2 * WIDE_BORDER)
    grids: list[AprilGrid] = []
    steps, upright = _steps(pairs, printed), np.roll(corners, printed.turns, axis=1)
    largest_first = np.argsort([-shortest_side(quad) for quad in corners])
    is_covered = np.zeros(len(corners), bool)
    for index in largest_first.tolist():
        if is_covered[index]:
            continue
        seeds = [
            GridTag(numbers[tag_index], place, upright[tag_index])
            for place, tag_index in _linked_tags(index, steps).items()
        ]
        tags = _complete_grid(grey, seeds, printed, name)
        codes = dictionary(name).codes[[tag.number for tag in tags]]
        cells = np.rot90(codes, -printed.turns, axes=(1, 2))
        grids.append(AprilGrid(tags, printed.gap, border, cells))
        is_covered |= _covers(grids[-1], corners)
    distinct: list[AprilGrid] = []
    for grid in sorted(grids, key=lambda grid: -len(grid.tags)):
        # A tag that the larger grid lacks may have led to the same grid once more.
        grid_corners = np.array([tag.corners for tag in grid.tags])
        is_repeat = any(_covers(larger, grid_corners).any() for larger in distinct)
        if len(grid.tags) >= MIN_TAGS and not is_repeat:
            distinct.append(grid)
    return distinct


def _print(pairs: Sequence[Pair]) -> Print | None:
    """Determine from pairs of neighbours how the grids are printed; None if there are too few."""
    rows = Counter(pair.turn for pair in pairs if pair.number_step == 1)
    if not rows:
        return None
    turns = rows.most_common(1)[0][0]
    # One row up is a quarter turn left of one to the right, one down a quarter turn right of it.
    row_steps = {(turns + 3) % 4: -1, (turns + 1) % 4: 1}
    columns = Counter(
        (pair.number_step, row_steps[pair.turn])
        for pair in pairs
        if pair.number_step > 1 and pair.turn in row_steps
    )
    cols, row_step = columns.most_common(1)[0][0] if columns else (None, -1)
    last = None if cols is None else _last_column(pairs, cols, turns)
    printed = Print(cols, 0.0, turns, row_step, last)
    gaps = [pair.gap for pair in pairs if _step(pair, printed)]
    if len(gaps) < MIN_TAGS - 1:
        return None
    gap = float(np.median(gaps))
    usual = USUAL_GAP_STEP * round(gap / USUAL_GAP_STEP)
    return printed._replace(gap=usual if abs(gap - usual) < USUAL_GAP_ERROR else gap)


def _last_column(pairs: Sequence[Pair], cols: int, turns: int) -> int | None:
    """Return the column, as numbers modulo columns, whose tags have none to their right.

    Tags of another grid beside theirs are allowed for. None if several columns have as few.
    """
    on_right = Counter(
        pair.number % cols for pair in pairs if (pair.number_step, pair.turn) == (1, turns)
    )
    fewest = min(on_right[column] for column in range(cols))
    columns = [column for column in range(cols) if on_right[column] == fewest]
    return columns[0] if len(columns) == 1 else None


def _step(pair: Pair, printed: Print) -> tuple[int, int] | None:
    """Return columns and rows from a pair's first tag to its second, None if grids have no such."""
    if (pair.number_step, pair.turn) == (1, printed.turns):
        return None if printed.ends_row(pair.number) else (1, 0)
    if (pair.number_step, pair.turn) == (printed.cols, (printed.turns + printed.row_step) % 4):
        return 0, printed.row_step
    return None


def _pairs(numbers: Sequence[int], corners: FloatArray) -> Iterator[Pair]:
    """Yield every two tags that are side by side."""
    inverse = np.linalg.inv(homographies_from_unit_square(corners))
    points = corners.reshape(1, -1, 2)
    seen = np.array([cv2.perspectiveTransform(points, homography) for homography in inverse])
    middles = seen.reshape(len(corners), -1, 4, 2).mean(axis=2) - 0.5
    distances, offsets = np.abs(middles).max(axis=2), np.abs(middles).min(axis=2)
    is_neighbour = (
        (1.0 + GRID_GAPS[0] < distances)
        & (distances < 1.0 + GRID_GAPS[1])
        & (offsets < MAX_OFF_AXIS)
    )
    for first, second in np.argwhere(is_neighbour).tolist():
        number_step = numbers[second] - numbers[first]
        if number_step > 0:
            x, y = middles[first, second]
            turn = (0 if x > 0.0 else 2) if abs(x) > abs(y) else (1 if y > 0.0 else 3)
            # A lens that shows one smaller than the other biases both, in opposite directions.
            gap = 0.5 * (distances[first, second] + distances[second, first]) - 1.0
            yield Pair(first, second, numbers[first], number_step, turn, gap)


def _steps(pairs: Sequence[Pair], printed: Print) -> Steps:
    """Return the steps from each tag that has a tag beside it."""
    steps: Steps = {}
    for pair in pairs:
        if step := _step(pair, printed):
            right, down = step
            steps.setdefault(pair.first, []).append((pair.second, right, down))
            steps.setdefault(pair.second, []).append((pair.first, -right, -down))
    return steps


def _linked_tags(seed: int, steps: Steps) -> dict[tuple[int, int], int]:
    """Return tags by their places relative to a seed, as far as steps lead from one to the next."""
    joined = {(0, 0): seed}
    following = [(seed, 0, 0)]
    while following:
        tag, x, y = following.pop()
        for neighbour, right, down in steps.get(tag, []):
            place = (x + right, y + down)
            if place not in joined:
                joined[place] = neighbour
                following.append((neighbour, *place))
    return joined


def _complete_grid(
    grey: NDArray[np.uint8], seeds: Sequence[GridTag], printed: Print, name: str
) -> list[GridTag]:
    """Return all tags of the grid that some of its tags belong to."""
    known = {seed.place: seed for seed in seeds}
    _correct_corners(grey, known, printed.gap)
    tried: dict[tuple[int, int], int] = {}
    while candidates := _places_to_try(known, printed, tried, len(dictionary(name).codes)):
        places, numbers = zip(*candidates.items(), strict=True)
        expected = np.array([_predicted_corners(known, place, printed.gap) for place in places])
        is_inside = ((expected >= 0.0) & (expected <= np.array(grey.shape[::-1]) - 1.0)).all((1, 2))
        quads = on_saddles(grey, expected[is_inside])
        upright = np.roll(quads, -printed.turns, axis=1)
        codes = np.array(numbers)[is_inside]
        correlations = agreement(grey, upright, name, WIDE_BORDER, codes).correlation
        for index, quad, correlation in zip(
            np.flatnonzero(is_inside), quads, correlations, strict=True
        ):
            if correlation >= MIN_AGREEMENT:
                known[places[index]] = GridTag(numbers[index], places[index], quad)
        _correct_corners(grey, known, printed.gap)
    return list(known.values())


def _correct_corners(
    grey: NDArray[np.uint8], known: dict[tuple[int, int], GridTag], gap: float
) -> None:
    """Replace wrong corners by those the tags around predict: errors would grow along the grid."""
    if len(known) < MIN_ROBUST:
        return
    expected = np.array([_smoothed_corners(known, place, gap) for place in known])
    found = on_saddles(grey, expected)
    distances = np.linalg.norm(found - expected, axis=2)
    limits = [MAX_OFF_SURFACE * shortest_side(quad) for quad in expected]
    is_near = (distances < np.array(limits)[:, None])[..., None]
    for tag, corners in zip(list(known.values()), np.where(is_near, found, expected), strict=True):
        known[tag.place] = tag._replace(corners=corners)


def _places_to_try(
    known: Mapping[tuple[int, int], GridTag],
    printed: Print,
    tried: dict[tuple[int, int], int],
    count: int,
) -> dict[tuple[int, int], int]:
    """Return numbers by places beside known tags, unless tried with as many tags around."""
    steps = [(1, 0, 1), (-1, 0, -1)]
    if printed.cols is not None:
        steps += [(0, printed.row_step, printed.cols), (0, -printed.row_step, -printed.cols)]
    candidates: dict[tuple[int, int], int] = {}
    for (x, y), tag in known.items():
        for right, down, number_step in steps:
            place, number = (x + right, y + down), tag.number + number_step
            if place in known or not 0 <= number < count:
                continue
            if down == 0 and printed.ends_row(min(number, tag.number)):
                continue
            neighbours = sum(
                (place[0] + i, place[1] + j) in known for i in (-1, 0, 1) for j in (-1, 0, 1)
            )
            if tried.get(place, 0) < neighbours:
                candidates[place] = number
                tried[place] = neighbours
    return candidates


def _predicted_corners(
    known: Mapping[tuple[int, int], GridTag], place: tuple[int, int], gap: float
) -> FloatArray:
    """Return the corners of the tag at a place, (4, 2), as predicted by the tags nearest to it."""
    return _corners_by_homography(*_nearest_corners(known, place, gap, NEAREST_TAGS))[0]


def _smoothed_corners(
    known: Mapping[tuple[int, int], GridTag], place: tuple[int, int], gap: float
) -> FloatArray:
    """Return the corners of a known tag, shape (4, 2), as predicted by the tags around it.

    They follow a homography or, where the lens bends them as well, a smooth surface.
    """
    model, seen = _nearest_corners(known, place, gap, SURROUNDING_TAGS)
    corners, fits = _corners_by_homography(model, seen)
    if fits.mean() >= MIN_PROJECTIVE or len(fits) < MIN_POINTS:
        return corners
    return SmoothSurface.of(model.reshape(-1, 2), seen.reshape(-1, 2)).at(UNIT_SQUARE)


def _nearest_corners(
    known: Mapping[tuple[int, int], GridTag], place: tuple[int, int], gap: float, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return corners of the known tags nearest to a place, relative to it, and in the picture."""
    nearest = heapq.nsmallest(count, known.values(), key=lambda tag: math.dist(tag.place, place))
    steps = [(tag.place[0] - place[0], tag.place[1] - place[1]) for tag in nearest]
    return _model(steps, gap), np.array([tag.corners for tag in nearest])


def _corners_by_homography(
    model: FloatArray, seen: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return corners of the tag at the origin, and which of those seen fit the homography."""
    method = cv2.RANSAC if len(seen) >= MIN_ROBUST else 0
    tolerance = MAX_OFF_SURFACE * min(shortest_side(quad) for quad in seen)
    homography, fits = cv2.findHomography(
        model.reshape(-1, 2), seen.reshape(-1, 2), method, tolerance
    )
    if homography is None:
        return np.full((4, 2), -1.0), np.zeros(4 * len(seen), bool)
    corners = cv2.perspectiveTransform(UNIT_SQUARE[None], homography)[0]
    return np.asarray(corners, dtype=np.float64), fits.ravel() != 0


def _model(places: Sequence[tuple[int, int]], gap: float) -> FloatArray:
    return np.asarray(UNIT_SQUARE + (1.0 + gap) * np.array(places, dtype=np.float64)[:, None])


def _covers(grid: AprilGrid, corners: FloatArray) -> NDArray[np.bool_]:
    """Return whether tags, shape (N, 4, 2), belong to a grid."""
    grid_corners = np.array([tag.corners for tag in grid.tags])
    sides = np.linalg.norm(grid_corners - np.roll(grid_corners, 1, axis=1), axis=2).min(axis=1)
    offsets = corners.mean(axis=1)[:, None] - grid_corners.mean(axis=1)
    return np.asarray((np.linalg.norm(offsets, axis=2) < 0.5 * sides).any(axis=1))
