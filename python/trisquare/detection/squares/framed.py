"""Selection of the curved quads that are squares on a ground: solid ones, and frames.

A figure stands alone on its ground: the ground surrounds it, also beyond the corners, where a
cell of a chessboard meets the next dark cell. Inside, it is either uniform or has exactly one
concentric square of the ground's kind; or it is a tag, whose inside is decoded elsewhere.
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
"""Returns a tag or None for each quad with these indices, which are dark and stand alone."""

CLEARANCE = 2.0
"""Distance from the outline, pixels, at which the levels of figure and ground are read: beyond most
of the blur, but within the narrow rim of a sheet seen from the side."""

MAX_CORNER_REACH = 9.0
"""Maximum distance beyond an acute corner, pixels: the ground's margin may be narrow."""

MIN_GROUND_SHARE = 0.97
"""Minimum fraction of the points around the outline on the ground's side; noise affects few."""

MAX_HIDDEN = 0.35
"""Maximum fraction of one side beside which something else lies: a quarter and the blur of its
rim."""

GROUND_LEVEL = 0.2
"""Distance from the middle of figure and ground, over their step, beyond which a point is
ground."""

INTERIOR_GRID = 13
INTERIOR_MARGIN = 0.1
"""Points per side of the grid inside, and its margin at the sides, over the square's width."""

MAX_UNEVENNESS = 0.2
MAX_UNEVEN_SHARE = 0.03
"""Deviation from the plane of light inside, over the step, beyond which a point is uneven; and the
maximum fraction of such points ..."""

UNEVEN_PER_HIDDEN = 0.35
"""... and its increase per fraction of a side without an edge of its own: a finger or glare over a
quarter of a side covers up to 8 % of the inside."""

MIN_RING_SHARE = 0.85
"""Minimum fraction of the points around a frame's hole on its ring, two sides being partly
hidden."""

FRAME_TOLERANCE = 0.03
FRAME_TOLERANCE_PIXELS = 2.0
"""Maximum distance of a frame's inner corners from a concentric square, over the outer side, plus
pixels: strong distortion moves them by 2 %, and acute corners are inaccurate by a pixel."""

FRAME_SIZES = (0.15, 0.75)
"""Range of inner over outer side of a frame. A thinner ring may as well be the rim of a sheet of
paper, cut by hand; then the inner outline alone is the square, which is correct for a thin frame
too."""

MIN_RATIO = 0.5
"""Minimum ratio of the areas of two outlines that lie right beside each other."""

MIN_RELATIVE_SIDE = 0.4
"""Minimum mean side over that of the third largest figure, if there are more than three. A smaller
square adds next to nothing to the calibration, and most are cells of boards whose neighbours are
hidden, or clutter."""

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of the square to which a quad is mapped to compare another one with it."""

MAX_LEVEL_DIFFERENCE = 0.15
"""Maximum difference of the ground inside a frame from that around it, over the step. A larger one
means a square on a sheet of its own on some other ground, not a frame: the sheet's rim is cut by
hand and is not part of the figure."""


@dataclass(frozen=True, slots=True)
class FramedSquare:
    """Indices of a square's outlines among the quads; `inner` is a frame's inner outline.

    `adjacent` is another outline right beside the square's, if there is one: of a thin frame or of
    the sheet.
    """

    outer: int
    inner: int | None
    tag: Tag | None = None
    adjacent: int | None = None


def find_framed_squares(
    picture: NDArray[np.float32], quads: Quads, read_tags: TagReader | None = None
) -> list[FramedSquare]:
    """Select the squares, frames and tags among quads.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        Each outline once.
    read_tags : callable, optional
        Without it tags are not searched for.
    """
    if len(quads) == 0:
        return []
    ground, figure = _levels_beside_sides(picture, quads)
    on_ground = _on_ground(quads, ground, figure)
    is_isolated = _are_isolated(picture, quads, ground, figure, on_ground)
    is_uniform = are_uniform(picture, quads)
    is_solid = is_isolated & is_uniform
    # Something that covers a frame's ring may end at a corner of the hole.
    is_hole = is_uniform & (on_ground.mean(axis=(1, 2)) >= MIN_RING_SHARE)
    areas = quads.areas
    middles = quads.corners.mean(axis=1)
    frames = [
        FramedSquare(outer, inner)
        for outer in np.flatnonzero(is_isolated & ~is_uniform).tolist()
        for inner in np.flatnonzero(
            is_hole
            & (quads.dark_inside != quads.dark_inside[outer])
            & (areas < areas[outer])
            & in_box(quads.corners[outer], middles)
        ).tolist()
        if _is_hole(_concentric_size(quads, outer, inner))
        and _is_same_ground(ground[outer], figure[inner], quads.contrasts[outer])
    ]
    inners = {frame.inner for frame in frames}
    solids = [
        FramedSquare(i, None, adjacent=_adjacent_outline(quads, areas, middles, i))
        for i in np.flatnonzero(is_solid).tolist()
        if i not in inners
    ]
    tags: list[FramedSquare] = []
    if read_tags is not None:
        candidates = np.flatnonzero(is_isolated & ~is_uniform & quads.dark_inside)
        read = zip(candidates.tolist(), read_tags(candidates), strict=True)
        tags = [FramedSquare(i, None, tag) for i, tag in read if tag is not None]
    # Cells of a tag are not squares of their own.
    figures = solids + frames
    cells = _figures_within(quads, tags, figures)
    figures = _innermost(quads, areas, tags, [f for f in figures if f.outer not in cells])
    kept = comparable_quads(quads, [figure.outer for figure in figures])
    return [figure for figure in figures if figure.outer in kept]


def reasons_against_quads(picture: NDArray[np.float32], quads: Quads) -> list[str]:
    """Return the reason for which `find_framed_squares` rejected each quad.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        None of them part of a figure.
    """
    if len(quads) == 0:
        return []
    ground, figure = _levels_beside_sides(picture, quads)
    is_isolated = _are_isolated(picture, quads, ground, figure, _on_ground(quads, ground, figure))
    reasons = np.where(
        ~is_isolated,
        "something else touches its sides or corners, or a shadow crosses them",
        np.where(
            ~are_uniform(picture, quads),
            "its inside is neither uniform nor that of a frame: squares with anything inside are "
            'found by targets="rectangle:1"',
            "it is far smaller than the others",
        ),
    )
    return [str(reason) for reason in reasons]


def _are_isolated(
    picture: NDArray[np.float32],
    quads: Quads,
    ground: FloatArray,
    figure: FloatArray,
    on_ground: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return whether the ground surrounds each quad, except for what may lie over one side."""
    is_ground_at_corners = _ground_beyond_corners(picture, quads, ground, figure)
    return _are_mostly_ground(on_ground) & is_ground_at_corners


def _levels_beside_sides(
    picture: NDArray[np.float32], quads: Quads
) -> tuple[FloatArray, FloatArray]:
    """Return grey levels just outside and inside the sides, each (Q, 4, N), without the ends."""
    step = CLEARANCE * quads.normals[:, :, None]
    points = quads.sides[:, :, 2:-2]
    return sample(picture, points + step), sample(picture, points - step)


def _on_ground(quads: Quads, ground: FloatArray, figure: FloatArray) -> NDArray[np.bool_]:
    """Return which points beside the sides, (Q, 4, N), are on the ground's side of the middle."""
    sign = np.where(quads.dark_inside, 1.0, -1.0)[:, None, None]
    middle = _middle(ground, figure)[..., None]
    return np.asarray(sign * (ground - middle) > GROUND_LEVEL * quads.contrasts[..., None])


def _middle(ground: FloatArray, figure: FloatArray) -> FloatArray:
    """Return the grey level between ground and figure for each side, (Q, 4)."""
    return np.asarray(0.5 * (np.median(ground, axis=2) + np.median(figure, axis=2)))


def _ground_beyond_corners(
    picture: NDArray[np.float32], quads: Quads, ground: FloatArray, figure: FloatArray
) -> NDArray[np.bool_]:
    """Return whether there is ground beyond the four corners of each quad."""
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


def _are_mostly_ground(on_ground: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether points (Q, 4, N) are on the ground, except a few and one run on one side."""
    shares = on_ground.mean(axis=2)
    weakest_side = np.take_along_axis(on_ground, shares.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    count = on_ground.shape[2]
    is_off_ground = ~weakest_side
    first = np.where(is_off_ground.any(axis=1), is_off_ground.argmax(axis=1), count)
    last = np.where(is_off_ground.any(axis=1), count - is_off_ground[:, ::-1].argmax(axis=1), count)
    is_short_run = last - first <= MAX_HIDDEN * count
    share_without_run = (on_ground.sum(axis=(1, 2)) + is_off_ground.sum(axis=1)) / (4 * count)
    is_enough = np.where(is_short_run, share_without_run, shares.mean(axis=1)) >= MIN_GROUND_SHARE
    return np.asarray(is_enough)


def _interior_grid() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corner weights at each point, (N, 4), planes there, (3, N), and their fit, (N, 3)."""
    fractions = np.linspace(INTERIOR_MARGIN, 1.0 - INTERIOR_MARGIN, INTERIOR_GRID)
    u, v = (grid.ravel() for grid in np.meshgrid(fractions, fractions))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    plane = np.stack([np.ones_like(u), u, v], axis=1)
    return weights, plane.T, np.asarray(np.linalg.pinv(plane).T, np.float64)


_INTERIOR_WEIGHTS, _PLANES, _FIT_OF_PLANE = _interior_grid()


def are_uniform(picture: NDArray[np.float32], quads: Quads) -> NDArray[np.bool_]:
    """Return whether the inside of each quad is uniform, except for a plane of light."""
    values = sample(picture, np.einsum("nc,qci->qni", _INTERIOR_WEIGHTS, quads.corners))
    values -= (values @ _FIT_OF_PLANE) @ _PLANES
    values -= np.median(values, axis=1, keepdims=True)
    step = quads.contrasts.mean(axis=1, keepdims=True)
    is_uneven = np.abs(values) > MAX_UNEVENNESS * step
    hidden = 1.0 - quads.seen.mean(axis=2).min(axis=1)
    return np.asarray(is_uneven.mean(axis=1) <= MAX_UNEVEN_SHARE + UNEVEN_PER_HIDDEN * hidden)


def _concentric_size(quads: Quads, outer: int, inner: int) -> float | None:
    """Return a quad's size over another's, if both are concentric, parallel squares."""
    corners = quads.corners[outer]
    mapped = map_to_square(quads.corners[inner], corners)
    mapped = np.roll(mapped, alignment(mapped, SQUARE), axis=0)
    size = float((mapped * SQUARE).mean())
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).min()
    tolerance = 2.0 * (FRAME_TOLERANCE + FRAME_TOLERANCE_PIXELS / side)
    return size if np.abs(mapped - size * SQUARE).max() < tolerance else None


def _is_hole(size: float | None) -> bool:
    return size is not None and FRAME_SIZES[0] < size < FRAME_SIZES[1]


def _adjacent_outline(
    quads: Quads, areas: FloatArray, middles: FloatArray, index: int
) -> int | None:
    """Return the other outline of a bar that begins at a quad's outline, around or within it."""
    ratios = areas / areas[index]
    is_near = (ratios > MIN_RATIO) & (ratios < 1.0 / MIN_RATIO)
    is_near &= quads.dark_inside != quads.dark_inside[index]
    sizes = {}
    for other in np.flatnonzero(is_near & in_box(quads.corners[index], middles)).tolist():
        outer, inner = (other, index) if ratios[other] > 1.0 else (index, other)
        size = _concentric_size(quads, outer, inner)
        if size is not None and size >= FRAME_SIZES[1]:
            sizes[other] = size
    return max(sizes, key=sizes.__getitem__, default=None)


def map_to_square(corners: FloatArray, outer: FloatArray) -> FloatArray:
    """Map corners, shape (4, 2), by the homography from the quad `outer`, (4, 2), to `SQUARE`."""
    square_from_image = cv2.getPerspectiveTransform(
        outer.astype(np.float32), SQUARE.astype(np.float32)
    )
    return np.asarray(cv2.perspectiveTransform(corners[None], square_from_image)[0])


def _is_same_ground(around: FloatArray, within: FloatArray, contrasts: FloatArray) -> bool:
    """Return whether the ground is the same around a frame and within it, sides averaged."""
    difference = np.median(around, axis=1).mean() - np.median(within, axis=1).mean()
    return bool(abs(difference) < MAX_LEVEL_DIFFERENCE * contrasts.mean())


def alignment(corners: FloatArray, reference: FloatArray) -> int:
    """Return how many places to roll `corners` (4, 2) to match `reference` (4, 2)."""
    distances = [np.sum((np.roll(corners, k, axis=0) - reference) ** 2) for k in range(4)]
    return int(np.argmin(distances))


def _innermost(
    quads: Quads, areas: FloatArray, tags: list[FramedSquare], figures: list[FramedSquare]
) -> list[FramedSquare]:
    """Drop figures that contain a tag or another figure: a sheet of paper is not a square."""
    kept = list(tags)
    middles = quads.corners.mean(axis=1)
    is_kept = np.zeros(len(quads), dtype=bool)
    is_kept[[tag.outer for tag in tags]] = True
    for figure in sorted(figures, key=lambda figure: areas[figure.outer]):
        if not _contains_any(quads, figure, middles[is_kept]):
            kept.append(figure)
            is_kept[figure.outer] = True
    return kept


def _figures_within(
    quads: Quads, containers: Sequence[FramedSquare], figures: Sequence[FramedSquare]
) -> set[int]:
    """Return the outer outlines of the figures whose middle lies in one of the holders."""
    middles = quads.corners.mean(axis=1)
    outers = [figure.outer for figure in figures]
    return {
        outer
        for container in containers
        for outer in np.array(outers)[in_box(_outline(quads, container), middles[outers])].tolist()
        if _contains_any(quads, container, middles[[outer]])
    }


def _contains_any(quads: Quads, figure: FramedSquare, points: FloatArray) -> bool:
    """Return whether any of some points, shape (N, 2), lies in a figure."""
    outline = _outline(quads, figure)
    near = points[in_box(outline, points)].tolist()
    return any(cv2.pointPolygonTest(outline, point, False) >= 0 for point in near)


def _outline(quads: Quads, figure: FramedSquare) -> NDArray[np.float32]:
    """Return points around a figure, shape (N, 2)."""
    return np.asarray(quads.sides[figure.outer].reshape(-1, 2), dtype=np.float32)


def comparable_quads(quads: Quads, indices: Sequence[int]) -> list[int]:
    """Drop quads far smaller than the three largest of those with the given indices."""
    if len(indices) <= 3:
        return list(indices)
    # Sides rather than areas: a square seen from the side keeps its length.
    chords = quads.sides[:, :, -1] - quads.sides[:, :, 0]
    sides = np.linalg.norm(chords, axis=-1).mean(axis=1)
    third_largest = np.sort(sides[list(indices)])[-3]
    return [i for i in indices if sides[i] >= MIN_RELATIVE_SIDE * third_largest]
