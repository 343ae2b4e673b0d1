"""White rims around the markers in a ChArUco board's light cells, from the picture.

A grid line is measured from the pixels beside it, and in a board with markers most of those on the
light side are a marker's. The cell's profile shows where the marker's dark border begins: dark
before the cell's edge, light behind it, and dark again.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import Lattice
from trisquare.detection.sampling import homographies_from_unit_square, sample

STEP = 1.0 / 48.0
SAMPLES_OUTSIDE = 12
SAMPLES_INSIDE = 22
"""Sampling of a profile: the distance between samples in cells, and their numbers before and behind
the cell's edge, where they reach nearly to the middle."""

SIDE_POSITIONS = np.array([0.3, 0.4, 0.5, 0.6, 0.7])
"""Positions along a cell's edge of the profiles: a marker is at least this wide."""

MAX_RIM = 0.4
"""Maximum rim in cells: the marker would be a fifth of its cell, which no camera can read."""

MIN_MARKERS = 3
"""Minimum number of cells that show a marker: stains and glare seldom come by threes."""

FIRST_CELLS = 12
"""Number of cells all over a board that are examined first: if none shows a marker, the board has
none."""

MAX_RIM_SPREAD = 0.05
"""Maximum difference of a cell's rim from the board's median, in cells: in cells around the
crossings it is 0.04."""

UPPER_PART = np.array([0.6, 0.7, 0.8])
"""Fractions of a profile's rise at which a rim is measured: above the half, but below its rounded
top, where noise would move it."""

CELLS_AT_ONCE = 1000
"""Number of cells that are sampled at once, because of a limit of OpenCV."""


def light_cells(shape: tuple[int, int], *, first_is_dark: bool) -> npt.NDArray[np.bool_]:
    """Return which cells of a board are light."""
    rows, cols = np.indices(shape)
    return np.asarray((rows + cols) % 2 == int(first_is_dark))


def marker_rims(
    grey: npt.NDArray[np.uint8], lattice: Lattice, *, first_is_dark: bool
) -> FloatArray | None:
    """Measure how far markers lie from the edges of their cells.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    lattice : Lattice
        The board's R x C crossings.
    first_is_dark : bool
        Whether the cell before the first crossing, in its row and column, is dark.

    Returns
    -------
    ndarray, shape (R + 1, C + 1), or None
        The rim of each cell between and around the crossings, over the cell's side, 0 without a
        marker; None if no cell has one.
    """
    rows, cols = lattice.present.shape
    corners = _cell_corners(lattice)
    light = light_cells((rows + 1, cols + 1), first_is_dark=first_is_dark)
    places = np.argwhere(light & np.isfinite(corners).all(axis=(2, 3)))
    if len(places) < MIN_MARKERS:
        return None
    light_corners = corners[places[:, 0], places[:, 1]]
    # The outer corners of the cells around are extrapolated.
    is_surrounded = ((places > 0) & (places < lattice.present.shape)).all(axis=1)
    surrounded = light_corners[is_surrounded]
    if not len(surrounded):
        return None
    first_cells = np.unique(np.linspace(0, len(surrounded) - 1, FIRST_CELLS, dtype=int))
    if not _rims(_profiles(grey, surrounded[first_cells])).any():
        return None
    pieces = [
        light_corners[start : start + CELLS_AT_ONCE]
        for start in range(0, len(light_corners), CELLS_AT_ONCE)
    ]
    profiles = np.concatenate([_profiles(grey, piece) for piece in pieces])
    cell_rims = _rims(profiles)
    is_surrounded &= cell_rims > 0.0
    if not is_surrounded.any():
        return None
    rim = float(np.median(cell_rims[is_surrounded]))
    is_typical = np.abs(cell_rims - rim) < MAX_RIM_SPREAD
    if np.count_nonzero(is_typical) < MIN_MARKERS or not (is_typical & is_surrounded).any():
        return None
    rims = np.zeros((rows + 1, cols + 1))
    rims[places[is_typical, 0], places[is_typical, 1]] = _refined_rim(
        profiles[is_typical & is_surrounded].mean(axis=0), rim
    )
    return rims


def _cell_corners(lattice: Lattice) -> FloatArray:
    """Return cells' corners between and around crossings, clockwise, (R + 1, C + 1, 4, 2).

    NaN where they are unknown; those of the cells around are extrapolated.
    """
    points = np.where(lattice.present[..., None], lattice.crossings, np.nan)
    for axis in (0, 1):
        first, second, *_ = np.moveaxis(points, axis, 0)
        *_, before, last = np.moveaxis(points, axis, 0)
        ahead, behind = 2.0 * first - second, 2.0 * last - before
        points = np.concatenate(
            [np.expand_dims(ahead, axis), points, np.expand_dims(behind, axis)], axis
        )
    around = [points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]]
    return np.stack(around, axis=2)


def _profiles(grey: npt.NDArray[np.uint8], corners: FloatArray) -> FloatArray:
    """Return mean shades of cells by the distance from their edges, inward, shape (N, samples)."""
    start, end = corners, np.roll(corners, -1, axis=1)
    inner_start, inner_end = np.roll(corners, 1, axis=1), np.roll(corners, -2, axis=1)
    depth = STEP * np.arange(-SAMPLES_OUTSIDE, SAMPLES_INSIDE + 1)[:, None, None]
    along = SIDE_POSITIONS[:, None]
    outer = start[:, :, None] + along * (end - start)[:, :, None]
    inner = inner_start[:, :, None] + along * (inner_end - inner_start)[:, :, None]
    places = outer[:, :, None] + depth * (inner - outer)[:, :, None]
    shades = sample(grey, places.reshape(len(corners), -1, 2))
    return np.asarray(shades.reshape(len(corners), 4, -1, len(SIDE_POSITIONS)).mean(axis=(1, 3)))


def _rims(profiles: FloatArray) -> FloatArray:
    """Return where profiles, (N, samples), fall again behind the edge, in cells; 0 if they do not.

    Blur and a wrong tone curve move the fall as far inward as they move the rise outward.
    """
    behind = profiles[:, SAMPLES_OUTSIDE:]
    top = behind.argmax(axis=1)
    peak = np.take_along_axis(behind, top[:, None], axis=1)[:, 0]
    half = 0.5 * (profiles[:, 0] + peak)
    is_above = profiles > half[:, None]
    samples = np.arange(profiles.shape[1])
    is_low_behind = ~is_above & (samples > SAMPLES_OUTSIDE + top[:, None])
    is_low_before = ~is_above & (samples < SAMPLES_OUTSIDE + top[:, None])
    fall_end = is_low_behind.argmax(axis=1)
    rise_end = profiles.shape[1] - is_low_before[:, ::-1].argmax(axis=1)
    rim = np.zeros(len(profiles))
    has_rim = is_low_behind.any(axis=1) & is_low_before.any(axis=1) & (peak > profiles[:, 0])
    if has_rim.any():
        indices = np.flatnonzero(has_rim)
        ends = [
            _level_crossings(profiles[indices], half[indices], end[indices])
            for end in (rise_end, fall_end)
        ]
        rim[indices] = STEP * (ends[0] + ends[1] - 2.0 * SAMPLES_OUTSIDE)
    return np.where((rim > 0.0) & (rim < MAX_RIM), rim, 0.0)


def _refined_rim(profile: FloatArray, rim: float) -> float:
    """Measure a rim again, in the upper part of the mean profile of cells, shape (samples,).

    In that part the rise and the fall mirror each other, whatever the blur and the tone curve are;
    below it, the bits beyond a marker's border lift the profile.
    """
    top = SAMPLES_OUTSIDE + int(
        profile[SAMPLES_OUTSIDE : SAMPLES_OUTSIDE + round(rim / STEP) + 1].argmax()
    )
    levels = profile[0] + UPPER_PART * (profile[top] - profile[0])
    is_above = profile > levels[:, None]
    samples = np.arange(len(profile))
    is_low_before, is_low_behind = ~is_above & (samples < top), ~is_above & (samples > top)
    has_both = is_low_before.any(axis=1) & is_low_behind.any(axis=1)
    if not has_both.any():
        return rim
    rise_end = len(profile) - is_low_before[has_both, ::-1].argmax(axis=1)
    fall_end = is_low_behind[has_both].argmax(axis=1)
    profiles = np.broadcast_to(profile, (len(rise_end), len(profile)))
    ends = [_level_crossings(profiles, levels[has_both], end) for end in (rise_end, fall_end)]
    refined = STEP * float((ends[0] + ends[1] - 2.0 * SAMPLES_OUTSIDE).mean())
    return refined if abs(refined - rim) < MAX_RIM_SPREAD else rim


def _level_crossings(
    profiles: FloatArray, level: FloatArray, after: npt.NDArray[np.intp]
) -> FloatArray:
    """Return where each profile crosses its level, between a sample and the one before it."""
    high = np.take_along_axis(profiles, after[:, None], axis=1)[:, 0]
    low = np.take_along_axis(profiles, after[:, None] - 1, axis=1)[:, 0]
    return np.asarray(after - 1 + (level - low) / (high - low))


USED_SHARE = 0.5
"""Fraction of the border and of the gap that is used: the other half is blurred by what follows."""

MARGIN_POSITIONS = (0.1, 0.5, 0.9)
"""Positions along a side, as fractions of it, at which the margin is computed; the minimum is
used."""


def side_margins(corners: FloatArray, border: float, gap: float) -> list[tuple[float, float]]:
    """Return the margins on the left, outside, and on the right of each side, pixels.

    Parameters
    ----------
    corners : ndarray, shape (4, 2)
        Corners of the marker, clockwise on the screen, pixels.
    border, gap : float
        Width of its plain border and of the white round it, over its side; infinite where nothing
        follows.

    Returns
    -------
    list of four tuples of float
        Left and right margin of each side.
    """
    inside, outside = (_margin(corners, share) for share in (border, -gap))
    return list(zip(outside, inside, strict=True))


def _margin(corners: FloatArray, share: float) -> list[float]:
    """Return distances from sides to lines inside, at `USED_SHARE` of a part of the square."""
    if math.isinf(share):
        return [math.inf] * 4
    turned = np.array([np.roll(corners, -side, axis=0) for side in range(4)])
    line_points = np.array([[(place, USED_SHARE * share) for place in MARGIN_POSITIONS]])
    margins = []
    for quad, homography in zip(turned, homographies_from_unit_square(turned), strict=True):
        seen = cv2.perspectiveTransform(line_points, homography)[0]
        start, end = quad[:2].astype(np.float32)
        along = (end - start).astype(np.float64)
        offsets = np.asarray(seen, dtype=np.float64) - start
        nearest = float(np.abs(along[0] * offsets[:, 1] - along[1] * offsets[:, 0]).min())
        margins.append(nearest / max(float(np.hypot(*along)), 1e-9))
    return margins
