"""Decoding of dark quads as tags: their inside is read as bits, and looked up in dictionaries.

Something in a picture may match a code by chance. The probability of that is computed, and a
dictionary is accepted only if so many hits among so many readings are next to impossible by chance
(a contrario reasoning: A. Desolneux, L. Moisan, J.-M. Morel, International Journal of
Computer Vision 40 (2000) 7-23).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import MIN_CONTRAST, Tag
from trisquare.detection.sampling import sample, straight_sides
from trisquare.detection.square_views import SquareViews
from trisquare.detection.tags.codes import Bits, Dictionary, dictionary, in_blocks, largest_products
from trisquare.detection.tags.families import WIDE_BORDERED, TagSearch

BORDER = 1
"""Width of the black border round a code, in cells."""

WIDE_BORDER = 2
"""Width of the wide border that tags of `WIDE_BORDERED` may have, in cells."""

PROBES = np.array([0.3, 0.5, 0.7])
"""Positions at which a cell's shade is sampled, in cells: clear of its neighbours' blur."""

MIN_CLEARANCE = 0.2
"""Distance from the middle of black and white, over their step, below which a bit is not
readable."""

MIN_CLEAR_SHARE = 0.95
"""Minimum fraction of a code's cells that are readable; glare or dirt may spoil one."""

MIN_DARK_SHARE = 0.9
"""Minimum fraction of the border's cells that are black."""

MIN_RELATIVE_STEP = 0.5
"""Minimum step from black to white inside, over the step across the outline."""

QUADS_AT_ONCE = 256
"""Number of quads whose shades are sampled together: the positions of each take some 20 kB."""

MAX_FALSE_ALARMS = 1e-2
"""Maximum expected number of dictionaries accepted by chance, per picture."""


def decode_tags(
    grey: NDArray[np.uint8], sides: FloatArray, steps: FloatArray, search: TagSearch
) -> list[Tag | None]:
    """Find which quads are tags.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    sides : ndarray, shape (Q, 4, N, 2)
        Sides of dark quads, clockwise on the screen, evenly spread over their chords, pixels.
    steps : ndarray, shape (Q,)
        Grey levels by which the ground is lighter than the quad.
    search : TagSearch

    Returns
    -------
    list of Tag or None, one for each quad
    """
    found: list[Tag | None] = [None] * len(sides)
    if len(sides) == 0:
        return found
    codebooks = [dictionary(name) for name in search.names]
    views = SquareViews.of(sides, _size(grey))
    readings = {key: _Reading.of(grey, views, steps, *key) for key in sorted(_grids(codebooks))}
    is_unread = np.ones(len(sides), bool)
    while True:
        best = min(
            (
                _Hits.of(codebook, readings[codebook.side, border], is_unread)
                for codebook in codebooks
                for border in _borders(codebook)
            ),
            key=lambda hits: hits.log_chance,
            default=None,
        )
        if best is None or not best.tags:
            return found
        if not search.stated and best.log_chance + math.log(len(codebooks)) > math.log(
            MAX_FALSE_ALARMS
        ):
            return found
        for quad, tag in best.tags.items():
            found[quad], is_unread[quad] = tag, False


def _borders(codebook: Dictionary) -> Sequence[int]:
    return (BORDER, WIDE_BORDER) if codebook.name == WIDE_BORDERED else (BORDER,)


def _grids(codebooks: Iterable[Dictionary]) -> set[tuple[int, int]]:
    return {(codebook.side, border) for codebook in codebooks for border in _borders(codebook)}


class _Reading(NamedTuple):
    """Bits of quads read as codes of one size, and which quads look like such a code at all."""

    bits: Bits  # (Q, n, n)
    is_clear: Bits  # (Q,)

    @classmethod
    def of(
        cls,
        grey: NDArray[np.uint8],
        views: SquareViews,
        steps: FloatArray,
        side: int,
        border: int,
    ) -> _Reading:
        cells = _cell_shades(grey, views, side + 2 * border)
        is_inner = np.zeros(cells.shape[1:], bool)
        is_inner[border:-border, border:-border] = True
        dark = np.median(cells[:, ~is_inner], axis=1)[:, None, None]
        brightest = cells[:, is_inner].max(axis=1)[:, None, None]
        is_lit = is_inner & (cells > 0.5 * (dark + brightest))
        count = np.maximum(is_lit.sum(axis=(1, 2), keepdims=True), 1)
        light = np.where(is_lit, cells, 0.0).sum(axis=(1, 2), keepdims=True) / count
        step = light - dark
        safe_step = np.maximum(step, 1.0)
        relative_levels = (cells - 0.5 * (dark + light)) / safe_step
        is_clear = (np.abs(relative_levels[:, is_inner]) >= MIN_CLEARANCE).mean(
            axis=1
        ) >= MIN_CLEAR_SHARE
        is_clear &= (relative_levels[:, ~is_inner] <= -MIN_CLEARANCE).mean(axis=1) >= MIN_DARK_SHARE
        is_clear &= step[:, 0, 0] >= np.maximum(MIN_CONTRAST, MIN_RELATIVE_STEP * steps)
        return cls(relative_levels[:, border:-border, border:-border] > 0.0, is_clear)


class Agreement(NamedTuple):
    """Agreement of the shades of quads' cells with a dictionary's codes."""

    numbers: NDArray[np.intp]  # (Q,) of the codes that agree best
    turns: NDArray[np.intp]  # (Q,) as of `Tag`
    correlation: FloatArray  # (Q,)


def agreement(
    grey: NDArray[np.uint8],
    corners: FloatArray,
    name: str,
    border: int,
    expected: NDArray[np.intp] | None = None,
) -> Agreement:
    """Compare quads, shape (Q, 4, 2), with all codes, or upright with those that are expected.

    Cells are not thresholded to bits: the single cells of a small tag are too blurred for that,
    while all of them together still determine its code.
    """
    codebook = dictionary(name)
    views = SquareViews.of(straight_sides(corners), _size(grey))
    cells = _cell_shades(grey, views, codebook.side + 2 * border)
    shades = _normalised(cells[:, border:-border, border:-border])
    if expected is not None:
        codes = _normalised(codebook.codes[expected])
        return Agreement(expected, np.zeros_like(expected), (shades * codes).sum(axis=1))
    best, correlation = largest_products(shades, _normalised_codes(name))
    turns, numbers = np.divmod(best, len(codebook.codes))
    return Agreement(numbers, turns, correlation)


@cache
def _normalised_codes(name: str) -> FloatArray:
    """Return codes in their four orientations, as `largest_products` takes them."""
    codes = dictionary(name).codes
    turned = [np.rot90(codes, turns, axes=(1, 2)) for turns in range(4)]
    return in_blocks(_normalised(np.concatenate(turned)))


def _normalised(cells: FloatArray | Bits) -> FloatArray:
    """Return the cells of each quad as a vector of unit length and zero sum, shape (Q, n * n)."""
    flat = cells.reshape(len(cells), cells.shape[1] ** 2) - cells.mean(axis=(1, 2))[:, None]
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9))


class _Hits(NamedTuple):
    """Tags of one dictionary, and the logarithm of the probability of as many by chance."""

    tags: dict[int, Tag]
    log_chance: float

    @classmethod
    def of(cls, codebook: Dictionary, reading: _Reading, is_unread: Bits) -> _Hits:
        quads = np.flatnonzero(reading.is_clear & is_unread)
        if not len(quads):
            return cls({}, 0.0)
        codes = codebook.look_up(reading.bits[quads])
        tags = {
            int(quad): Tag(codebook.name, *code)
            for quad, code in zip(quads, codes, strict=True)
            if code is not None
        }
        return cls(tags, _log_binomial_tail(len(quads), len(tags), codebook.chance))


def _log_binomial_tail(trials: int, hits: int, chance: float) -> float:
    """Return the logarithm of the probability of so many hits or more."""
    if hits == 0:
        return 0.0
    odds = math.log(chance) if chance > 0.0 else -math.inf
    misses = math.log1p(-chance) if chance < 1.0 else -math.inf
    terms = [
        math.log(math.comb(trials, k)) + k * odds + ((trials - k) * misses if k < trials else 0.0)
        for k in range(hits, trials + 1)
    ]
    largest = max(terms)
    return largest + math.log(sum(math.exp(term - largest) for term in terms))


def _size(grey: NDArray[np.uint8]) -> tuple[int, int]:
    return grey.shape[1], grey.shape[0]


def _cell_shades(grey: NDArray[np.uint8], views: SquareViews, cells: int) -> FloatArray:
    """Return the mean shade of each cell of quads cut into a grid, shape (Q, cells, cells)."""
    places = (np.arange(cells)[:, None] + PROBES).ravel() / cells
    u, v = np.meshgrid(places, places)
    probes = np.stack([u.ravel(), v.ravel()], axis=1)
    shades = np.empty((len(views), cells, cells))
    for first in range(0, len(views), QUADS_AT_ONCE):
        batch = slice(first, first + QUADS_AT_ONCE)
        # A row of samples for every quad: rows of cells, probes, columns of cells, probes.
        grid = sample(grey, views.subset(batch).points(probes))
        grid = grid.reshape(-1, cells, len(PROBES), cells, len(PROBES))
        shades[batch] = grid.mean(axis=(2, 4))
    return shades
