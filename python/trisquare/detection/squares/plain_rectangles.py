"""Rectangles of a known or an unknown shape: sheets of paper, cards, screens.

They lie on any ground and may carry any print, so that neither the ground nor the inside needs to
be uniform. Their shape distinguishes them from other four-sided things.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.squares.arc_quads import edge_shares
from trisquare.detection.squares.framed import (
    comparable_quads,
    find_framed_squares,
    map_to_square,
)
from trisquare.detection.squares.quads import (
    SAME_QUAD_FRACTION,
    SAME_QUAD_PIXELS,
    Quads,
    overlapping,
)
from trisquare.detection.squares.rectangle_shape import RectangleShape
from trisquare.detection.squares.rectified import closeness, rectangle_deviations

MIN_INLIERS = (0.55, 0.4)
"""Minimum fraction of a side's points on its curve, and that of the weakest side: what lies beside
a sheet may be as light as the sheet."""

DRAWING_BONUS = 0.1
"""Excess of a drawing's deviation over its sheet's up to which the drawing is preferred: in the
middle of a sheet with equal margins it has nearly the sheet's shape."""

PRINT_MALUS = 0.05
"""Amount by which the deviation of a quad that fills much of another has to be smaller to be
preferred if it is no drawing: prints fill most of their sheets, and have nearly their shape."""

CORNER_ERROR = 2.0
"""Assumed error of the corners, pixels: small figures have the shape by chance."""

MIN_DRAWING = 0.25
"""Minimum area of a drawing over its sheet's. A smaller one is a picture printed on the sheet."""

MAX_MIDDLE_OFFSET = 0.08
"""Maximum distance of a drawing's middle from its sheet's, over half the sheet."""


def best_per_corner(picture: NDArray[np.float32], quads: Quads) -> Quads:
    """Keep, of quads that share a corner, the one with the most edge.

    A corner belongs to one rectangle only, but three sides of a sheet and a piece of something else
    make a quad, too.
    """
    corners, sizes = quads.corners, np.sqrt(quads.areas)
    kept: list[int] = []
    for i in np.argsort(-edge_shares(picture, quads).mean(axis=1), kind="stable").tolist():
        gaps = np.abs(corners[kept][:, :, None] - corners[i]).max(axis=-1)
        if not (gaps < SAME_QUAD_PIXELS + SAME_QUAD_FRACTION * sizes[i]).any():
            kept.append(i)
    return quads.subset(np.array(kept, dtype=np.intp))


def find_rectangles(
    picture: NDArray[np.float32], quads: Quads, aspect: float | None
) -> NDArray[np.intp]:
    """Return the indices of the quads that are figures of their own, none within another.

    Of a sheet and what lies on it, the quad nearer to the given shape is kept: a drawing in the
    middle of its sheet, but not a label, nor a printed picture. The shapes are those
    under the focal length that makes the kept quads fit most closely. For any shape, quads that are
    uniform and stand alone, as a drawing, come first; of all others the outermost is kept, whatever
    it carries.

    Parameters
    ----------
    picture : ndarray of float32, shape (H, W)
    quads : Quads
        Each outline once.
    aspect : float, optional
        The longer side over the shorter; None for any.
    """
    solid = [figure.outer for figure in find_framed_squares(picture, quads)]
    overlaps = overlapping(quads.corners)
    if aspect is None:
        order = [*solid, *np.argsort(-quads.areas, kind="stable").tolist()]
        kept = _apart(order, overlaps)
    else:
        size = (picture.shape[1], picture.shape[0])
        deviations, _ = rectangle_deviations(quads.corners, size, aspect)
        deviations += CORNER_ERROR / np.sqrt(quads.areas)
        drawings = [i for i in solid if _is_drawing(quads, i)]
        deviations[:, drawings] -= DRAWING_BONUS
        area_ratios = quads.areas[:, None] / quads.areas
        fills = overlaps & (area_ratios >= MIN_DRAWING) & (area_ratios < 1.0)
        prints = np.setdiff1d(np.flatnonzero(fills.any(axis=1)), drawings)
        deviations[:, prints] += PRINT_MALUS
        orders = np.argsort(deviations, axis=1, kind="stable").tolist()
        choices = [_apart(order, overlaps) for order in orders]
        # A large quad counts more than a small one, but less than several.
        fits = closeness(deviations) * quads.areas**0.25
        sums = [fits[lens, choice].sum() for lens, choice in enumerate(choices)]
        kept = choices[int(np.argmax(sums))]
    return np.array(comparable_quads(quads, kept), dtype=np.intp)


def _apart(order: Sequence[int], overlaps: NDArray[np.bool_]) -> list[int]:
    """Return the quads, the first ones of an order, of which none overlaps another."""
    kept: list[int] = []
    for i in order:
        if not overlaps[i, kept].any():
            kept.append(i)
    return kept


def _is_drawing(quads: Quads, inner: int) -> bool:
    """Return whether a quad has equal opposite margins within another, of which it fills much."""
    is_sheet = quads.areas * MIN_DRAWING <= quads.areas[inner]
    is_sheet[inner] = False
    sheets = quads.corners[is_sheet]
    return any(_is_in_the_middle(quads.corners[inner], sheet) for sheet in sheets)


def _is_in_the_middle(inner: FloatArray, outer: FloatArray) -> bool:
    """Return whether the diagonals of one quad, corners (4, 2), have the middle of another's."""
    mapped = map_to_square(inner, outer)
    middles = 0.5 * (mapped[:2] + mapped[2:])
    return bool(np.abs(mapped).max() < 1.0 and np.abs(middles).max() < MAX_MIDDLE_OFFSET)


def turns_to_longer_side(
    corners: FloatArray, image_size: tuple[int, int], shape: RectangleShape
) -> NDArray[np.intp]:
    """Return how far to roll the sides of quads, corners (Q, 4, 2), to start with the longer."""
    deviations, is_longer = rectangle_deviations(corners, image_size, shape.aspect)
    best = closeness(deviations).sum(axis=1).argmax()
    return np.where(is_longer[best], 0, -1)
