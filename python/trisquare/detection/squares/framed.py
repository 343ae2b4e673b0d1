"""Which curved quads are squares on a ground: solid ones, and frames of two outlines.

A figure stands alone on its ground: the ground surrounds it, beyond the corners too, where a
cell of a chessboard meets the next dark cell. Inside, it is either uniform or has exactly one
concentric square of the ground's kind; or it is a tag, whose inside is read by others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Tag
from trisquare.detection.sampling import sample
from trisquare.detection.squares.quads import Quads, in_box

TagReader = Callable[[NDArray[np.intp]], Sequence[Tag | None]]
"""Tells which of the quads with these indices, dark and standing alone, are tags."""

CLEARANCE = 2.0
"""Pixels from the outline at which the levels of figure and ground are told: most of the blur is
passed there, and the narrow rim of a sheet seen from the side is not."""

MAX_CORNER_REACH = 9.0
"""Pixels beyond an acute corner at most: the ground's margin may be narrow."""

MIN_GROUND_SHARE = 0.97
"""Of the points around the outline, those that must be on the ground's side; noise takes few."""

MAX_HIDDEN = 0.35
"""Share of one side beside which something else may lie: a quarter and the blur of its rim."""

GROUND_LEVEL = 0.2
"""Steps beyond the middle of figure and ground at which a point counts as ground."""

INTERIOR_GRID = 13
INTERIOR_MARGIN = 0.1
"""The grid that is looked at inside, and what it leaves out at the sides, of the square's width."""

MAX_UNEVENNESS = 0.2
MAX_UNEVEN_SHARE = 0.03
"""Share of the inside that may differ from its plane of light by this part of the step ..."""

UNEVEN_PER_HIDDEN = 0.35
"""... and what may be added to it per part of a side without an edge of its own: a finger or glare
over a quarter of a side covers up to 8 % of the inside."""

MIN_RING_SHARE = 0.85
"""Of the points around a frame's hole, those that must be on its ring, two sides in part hidden."""

FRAME_TOLERANCE = 0.03
FRAME_TOLERANCE_PIXELS = 2.0
"""How far a frame's inner corners may be from a concentric square, over the outer side, and in
pixels on top: strong distortion moves them by 2 %, and acute corners are coarse by a pixel."""

FRAME_SIZES = (0.15, 0.75)
"""Inner over outer side of a frame. A thinner ring may as well be the rim of a sheet of paper,
cut by hand; then the inner outline alone is the square, which is true of a thin frame too."""

MIN_RATIO = 0.5
"""Of the areas of two outlines that lie right beside each other."""

MIN_RELATIVE_SIDE = 0.4
"""Of the third largest figure's mean side, when there are more than three. A smaller square adds
next to nothing to the calibration, and most are cells of boards with their neighbours hidden,
or clutter."""

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of the square in which one quad within another is looked at."""

MAX_LEVEL_DIFFERENCE = 0.15
"""Steps between the ground inside a frame and around it. More means a square on a sheet of its
own on some other ground, not a frame: the sheet's rim is cut by hand and no part of the figure."""


@dataclass(frozen=True, slots=True)
class FramedSquare:
    """Indices of a square's outlines among the quads; `inner` is a frame's inner outline.

    Right `beside` a square's outline there may be another, of a frame too thin for two or of the
    sheet.
    """

    outer: int
    inner: int | None
    tag: Tag | None = None
    beside: int | None = None


def find_framed_squares(
    picture: NDArray[np.float32], quads: Quads, read_tags: TagReader | None = None
) -> list[FramedSquare]:
    """Tell squares, frames and tags from everything else that has four sides.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        Each outline once.
    read_tags : callable, optional
        Without it no tags are looked for.
    """
    if len(quads) == 0:
        return []
    ground, figure = _levels_beside_sides(picture, quads)
    on_ground = _on_ground(quads, ground, figure)
    standing_alone = _standing_alone(picture, quads, ground, figure, on_ground)
    uniform = are_uniform(picture, quads)
    solid = standing_alone & uniform
    # What comes over a frame's ring may end at a corner of the hole.
    hole = uniform & (on_ground.mean(axis=(1, 2)) >= MIN_RING_SHARE)
    areas = quads.areas
    middles = quads.corners.mean(axis=1)
    frames = [
        FramedSquare(outer, inner)
        for outer in np.flatnonzero(standing_alone & ~uniform).tolist()
        for inner in np.flatnonzero(
            hole
            & (quads.dark_inside != quads.dark_inside[outer])
            & (areas < areas[outer])
            & in_box(quads.corners[outer], middles)
        ).tolist()
        if _is_hole(_concentric_size(quads, outer, inner))
        and _same_ground(ground[outer], figure[inner], quads.contrasts[outer])
    ]
    inners = {frame.inner for frame in frames}
    solids = [
        FramedSquare(i, None, beside=_outline_beside(quads, areas, middles, i))
        for i in np.flatnonzero(solid).tolist()
        if i not in inners
    ]
    tags: list[FramedSquare] = []
    if read_tags is not None:
        candidates = np.flatnonzero(standing_alone & ~uniform & quads.dark_inside)
        read = zip(candidates.tolist(), read_tags(candidates), strict=True)
        tags = [FramedSquare(i, None, tag) for i, tag in read if tag is not None]
    # Cells of a tag are no squares of their own.
    figures = solids + frames
    cells = _held_by(quads, tags, figures)
    figures = _innermost(quads, areas, tags, [f for f in figures if f.outer not in cells])
    kept = of_comparable_size(quads, [figure.outer for figure in figures])
    return [figure for figure in figures if figure.outer in kept]


def reasons_against_quads(picture: NDArray[np.float32], quads: Quads) -> list[str]:
    """Say of each quad that `find_framed_squares` rejected what speaks against it.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        None of them part of a figure.
    """
    if len(quads) == 0:
        return []
    ground, figure = _levels_beside_sides(picture, quads)
    alone = _standing_alone(picture, quads, ground, figure, _on_ground(quads, ground, figure))
    reasons = np.where(
        ~alone,
        "something else touches its sides or corners",
        np.where(
            ~are_uniform(picture, quads),
            "its inside is neither uniform nor that of a frame: squares with anything inside are "
            'found by targets="rectangle:1"',
            "it is far smaller than the others",
        ),
    )
    return [str(reason) for reason in reasons]


def _standing_alone(
    picture: NDArray[np.float32],
    quads: Quads,
    ground: FloatArray,
    figure: FloatArray,
    on_ground: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Whether the ground surrounds each quad, but for what may lie over one side."""
    beyond_corners = _ground_beyond_corners(picture, quads, ground, figure)
    return _but_for_one_run(on_ground) & beyond_corners


def _levels_beside_sides(
    picture: NDArray[np.float32], quads: Quads
) -> tuple[FloatArray, FloatArray]:
    """Grey levels just outside and just inside the sides, each (Q, 4, N), the ends left out."""
    step = CLEARANCE * quads.normals[:, :, None]
    points = quads.sides[:, :, 2:-2]
    return sample(picture, points + step), sample(picture, points - step)


def _on_ground(quads: Quads, ground: FloatArray, figure: FloatArray) -> NDArray[np.bool_]:
    """Which points beside the sides, (Q, 4, N), are on the ground's side of the middle."""
    sign = np.where(quads.dark_inside, 1.0, -1.0)[:, None, None]
    middle = _middle(ground, figure)[..., None]
    return np.asarray(sign * (ground - middle) > GROUND_LEVEL * quads.contrasts[..., None])


def _middle(ground: FloatArray, figure: FloatArray) -> FloatArray:
    """Grey level between ground and figure for each side, (Q, 4)."""
    return np.asarray(0.5 * (np.median(ground, axis=2) + np.median(figure, axis=2)))


def _ground_beyond_corners(
    picture: NDArray[np.float32], quads: Quads, ground: FloatArray, figure: FloatArray
) -> NDArray[np.bool_]:
    """Whether there is ground beyond the four corners of each quad."""
    sign = np.where(quads.dark_inside, 1.0, -1.0)[:, None]
    middle = _middle(ground, figure)
    along = np.diff(quads.sides, axis=2)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    arriving, leaving = np.roll(along[:, :, -1], 1, axis=1), along[:, :, 0]
    outward = arriving - leaving
    spread = np.linalg.norm(outward, axis=-1, keepdims=True)  # twice the half angle's cosine
    reach = np.minimum(
        CLEARANCE / np.sqrt(np.maximum(1.0 - spread**2 / 4.0, 1e-6)), MAX_CORNER_REACH
    )
    values = sample(picture, quads.corners + reach * outward / spread)
    at_corner = 0.5 * (middle + np.roll(middle, 1, axis=1))
    contrast = 0.5 * (quads.contrasts + np.roll(quads.contrasts, 1, axis=1))
    return np.asarray((sign * (values - at_corner) > GROUND_LEVEL * contrast).all(axis=1))


def _but_for_one_run(on_ground: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the points (Q, 4, N) are on the ground but for a few, and one run on one side."""
    shares = on_ground.mean(axis=2)
    spoilt = np.take_along_axis(on_ground, shares.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    count = on_ground.shape[2]
    off = ~spoilt
    first = np.where(off.any(axis=1), off.argmax(axis=1), count)
    last = np.where(off.any(axis=1), count - off[:, ::-1].argmax(axis=1), count)
    one_run = last - first <= MAX_HIDDEN * count
    without_run = (on_ground.sum(axis=(1, 2)) + off.sum(axis=1)) / (4 * count)
    enough = np.where(one_run, without_run, shares.mean(axis=1)) >= MIN_GROUND_SHARE
    return np.asarray(enough)


def _interior_grid() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weigh the corners at each point, (N, 4); planes there, (3, N), and what fits them, (N, 3)."""
    fractions = np.linspace(INTERIOR_MARGIN, 1.0 - INTERIOR_MARGIN, INTERIOR_GRID)
    u, v = (grid.ravel() for grid in np.meshgrid(fractions, fractions))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    plane = np.stack([np.ones_like(u), u, v], axis=1)
    return weights, plane.T, np.asarray(np.linalg.pinv(plane).T, np.float64)


_INTERIOR_WEIGHTS, _PLANES, _FIT_OF_PLANE = _interior_grid()


def are_uniform(picture: NDArray[np.float32], quads: Quads) -> NDArray[np.bool_]:
    """Whether the inside of each quad is even but for a plane of light."""
    values = sample(picture, np.einsum("nc,qci->qni", _INTERIOR_WEIGHTS, quads.corners))
    values -= (values @ _FIT_OF_PLANE) @ _PLANES
    values -= np.median(values, axis=1, keepdims=True)
    step = quads.contrasts.mean(axis=1, keepdims=True)
    uneven = np.abs(values) > MAX_UNEVENNESS * step
    hidden = 1.0 - quads.seen.mean(axis=2).min(axis=1)
    return np.asarray(uneven.mean(axis=1) <= MAX_UNEVEN_SHARE + UNEVEN_PER_HIDDEN * hidden)


def _concentric_size(quads: Quads, outer: int, inner: int) -> float | None:
    """Size of a quad over another's, if it is a concentric, parallel square in their plane."""
    corners = quads.corners[outer]
    mapped = seen_in_square(quads.corners[inner], corners)
    mapped = np.roll(mapped, alignment(mapped, SQUARE), axis=0)
    size = float((mapped * SQUARE).mean())
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).min()
    tolerance = 2.0 * (FRAME_TOLERANCE + FRAME_TOLERANCE_PIXELS / side)
    return size if np.abs(mapped - size * SQUARE).max() < tolerance else None


def _is_hole(size: float | None) -> bool:
    return size is not None and FRAME_SIZES[0] < size < FRAME_SIZES[1]


def _outline_beside(quads: Quads, areas: FloatArray, middles: FloatArray, index: int) -> int | None:
    """Return the outline, about a quad's or within it, at which a bar ends that begins there."""
    ratios = areas / areas[index]
    near = (ratios > MIN_RATIO) & (ratios < 1.0 / MIN_RATIO)
    near &= quads.dark_inside != quads.dark_inside[index]
    sizes = {}
    for other in np.flatnonzero(near & in_box(quads.corners[index], middles)).tolist():
        outer, inner = (other, index) if ratios[other] > 1.0 else (index, other)
        size = _concentric_size(quads, outer, inner)
        if size is not None and size >= FRAME_SIZES[1]:
            sizes[other] = size
    return max(sizes, key=sizes.__getitem__, default=None)


def seen_in_square(corners: FloatArray, outer: FloatArray) -> FloatArray:
    """Where corners, shape (4, 2), lie if the quad `outer`, shape (4, 2), is seen as `SQUARE`."""
    square_from_image = cv2.getPerspectiveTransform(
        outer.astype(np.float32), SQUARE.astype(np.float32)
    )
    return np.asarray(cv2.perspectiveTransform(corners[None], square_from_image)[0])


def _same_ground(around: FloatArray, within: FloatArray, contrasts: FloatArray) -> bool:
    """Whether the ground is the same around a frame and within it, sides averaged."""
    difference = np.median(around, axis=1).mean() - np.median(within, axis=1).mean()
    return bool(abs(difference) < MAX_LEVEL_DIFFERENCE * contrasts.mean())


def alignment(corners: FloatArray, reference: FloatArray) -> int:
    """How many places to roll `corners` (4, 2) so that they go with `reference` (4, 2)."""
    distances = [np.sum((np.roll(corners, k, axis=0) - reference) ** 2) for k in range(4)]
    return int(np.argmin(distances))


def _innermost(
    quads: Quads, areas: FloatArray, tags: list[FramedSquare], figures: list[FramedSquare]
) -> list[FramedSquare]:
    """Drop figures that hold a tag or another figure: a sheet of paper is no square of its own."""
    kept = list(tags)
    middles = quads.corners.mean(axis=1)
    is_kept = np.zeros(len(quads), dtype=bool)
    is_kept[[tag.outer for tag in tags]] = True
    for figure in sorted(figures, key=lambda figure: areas[figure.outer]):
        if not _holds_any(quads, figure, middles[is_kept]):
            kept.append(figure)
            is_kept[figure.outer] = True
    return kept


def _held_by(
    quads: Quads, holders: Sequence[FramedSquare], figures: Sequence[FramedSquare]
) -> set[int]:
    """Outer outlines of the figures whose middle lies in one of the holders."""
    middles = quads.corners.mean(axis=1)
    outers = [figure.outer for figure in figures]
    return {
        outer
        for holder in holders
        for outer in np.array(outers)[in_box(_outline(quads, holder), middles[outers])].tolist()
        if _holds_any(quads, holder, middles[[outer]])
    }


def _holds_any(quads: Quads, figure: FramedSquare, points: FloatArray) -> bool:
    """Whether one of some points, shape (N, 2), lies in a figure."""
    outline = _outline(quads, figure)
    near = points[in_box(outline, points)].tolist()
    return any(cv2.pointPolygonTest(outline, point, False) >= 0 for point in near)


def _outline(quads: Quads, figure: FramedSquare) -> NDArray[np.float32]:
    """Points around a figure, shape (N, 2)."""
    return np.asarray(quads.sides[figure.outer].reshape(-1, 2), dtype=np.float32)


def of_comparable_size(quads: Quads, indices: Sequence[int]) -> list[int]:
    """Drop quads far smaller than the three largest of those with some indices."""
    if len(indices) <= 3:
        return list(indices)
    # Sides rather than areas: a square seen from the side keeps its length.
    chords = quads.sides[:, :, -1] - quads.sides[:, :, 0]
    sides = np.linalg.norm(chords, axis=-1).mean(axis=1)
    third_largest = np.sort(sides[list(indices)])[-3]
    return [i for i in indices if sides[i] >= MIN_RELATIVE_SIDE * third_largest]
