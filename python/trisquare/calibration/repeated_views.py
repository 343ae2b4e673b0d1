"""Photographs that repeat an earlier one, with the same noise, because they were saved again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.edges import PlaneEdges

MIN_CORRELATION = 0.3
"""Correlation of the samples' noise above which it is the same. For three photographs of boards
that were saved again as JPEG, quality 95 to 40, it was 0.92 to 1; for rendered squares, quality 95
and 90, 0.24 to 0.97; for rendered ones with different noise up to 0.08."""

MIN_SAMPLES = 400
"""Minimum number of samples: with fewer, a correlation may be chance."""

TREND_DEGREE = 3
"""Degree of the polynomial fitted to the samples of a side; the remainder is their noise."""

MAX_OFFSET = 20.0
"""Maximum distance (px) between the mean points of two figures that are compared."""


def repeated_views(figures: Iterable[PlaneEdges]) -> dict[int, int]:
    """Return the index of the first photograph of the same view, by index of each repeated one."""
    views: dict[int, list[PlaneEdges]] = {}
    for figure in figures:
        views.setdefault(figure.image, []).append(figure)
    first: list[int] = []
    repeated: dict[int, int] = {}
    for image, view in views.items():
        twin = next((earlier for earlier in first if _are_same(views[earlier], view)), None)
        if twin is None:
            first.append(image)
        else:
            repeated[image] = twin
    return repeated


def _are_same(view: Sequence[PlaneEdges], other: Sequence[PlaneEdges]) -> bool:
    shapes, twin_shapes = ([len(figure.points) for figure in each] for each in (view, other))
    if shapes != twin_shapes:
        return False
    products = np.zeros(3)
    for figure, twin in zip(view, other, strict=True):
        middle, twin_middle = (np.vstack(each.points).mean(axis=0) for each in (figure, twin))
        if np.abs(middle - twin_middle).max() > MAX_OFFSET:
            return False
        for side, twin_side in zip(figure.points, twin.points, strict=True):
            products += _products_of_noise(side, twin_side)
    noise, twin_noise, noise_product = products
    count = sum(len(side) for figure in view for side in figure.points)
    return count >= MIN_SAMPLES and bool(
        noise_product > MIN_CORRELATION * np.sqrt(noise * twin_noise)
    )


def _products_of_noise(side: FloatArray, other: FloatArray) -> FloatArray:
    """Return three sums over a side: of its squared noise, of the other's, and of their product."""
    along = int(np.argmax(np.ptp(side, axis=0)))
    order = np.argsort(other[:, along])
    places = side[:, along]
    resampled = np.interp(places, other[order, along], other[order, 1 - along])
    noise, other_noise = (_noise(places, offsets) for offsets in (side[:, 1 - along], resampled))
    return np.array([noise @ noise, other_noise @ other_noise, noise @ other_noise])


def _noise(places: FloatArray, offsets: FloatArray) -> FloatArray:
    degree = min(TREND_DEGREE, len(places) - 1)
    trend = np.polynomial.Polynomial.fit(places, offsets, degree)
    return np.asarray(offsets - trend(places))
