"""Saddle points of the grey levels: where the corners of four cells of a chessboard may meet.

Next to a crossing the grey levels rise toward two opposite cells and fall toward the other two,
whatever the lens and the perspective do. That is a negative determinant of their second
derivatives, and the directions in which these vanish are those of the two edges that cross.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.sampling import sample

MIN_SADDLE = 1.1
"""Grey levels per square pixel, the geometric mean of a saddle's two curvatures. A crossing of
contrast 30 whose edges are blurred by 2 pixels of the searched picture has 1.6; noise of 8 grey
levels, halved once, leaves 0.4."""

APERTURE = 5
"""Pixels per side of the derivative filters: a smoothing of about one pixel, which cells of five
pixels survive."""

FILTER_GAIN = 64.0
"""What these filters make of a second derivative of one grey level per square pixel."""

MAX_OFFSET = 1.2
"""Pixels from the strongest pixel to the saddle point itself. At the corner of a lone square the
grey levels are curved alike, but have a slope: the saddle lies farther away or nowhere."""

FAR_OFFSET = 2.5
ARRIVED = 0.6
"""Pixels to a saddle that print beside it has drawn the strongest pixel away from, and what is
left of them one step later, when the nearest pixel is at most half a pixel off."""

MOST_UNEVEN = 3.0
"""Ratio of a saddle's two curvatures. Where edges cross they are equal, at whatever angle and
however blurred; the smallest cells leave a ratio of 2. Noise along stripes leaves any."""

RING = 2.5
"""Pixels from a saddle at which its four sectors are looked at: inside a cell of five pixels."""

FAR_RING = 5.0
"""Pixels from a saddle at which its edges are looked for again: as far as blur turns them toward
each other's right angle in the ring, and it has faded."""

MOST_TURNED = 0.6
"""Radians, 34 degrees, by which blur turns an edge at most: what lies farther off is another."""

LEAST_EDGE = 0.3
"""Of the step between light and dark, what an edge has at a pixel beside it, or there is none but
the end of a cell."""

HALF_TURN = 16
"""Directions looked in from a saddle, over half a turn."""

_DIRECTIONS = np.stack(
    [
        np.cos(np.arange(2 * HALF_TURN) * (np.pi / HALF_TURN)),
        np.sin(np.arange(2 * HALF_TURN) * (np.pi / HALF_TURN)),
    ],
    axis=1,
)

MIN_ALTERNATION = 0.5
"""Least step between a light sector and a dark one over the mean step: noise and one-sided
shading leave more, the end of a line or a bend less."""

RIVAL_WINDOW = 5
LEAST_OF_RIVAL = 0.6
"""A saddle this much weaker than another one in a window of that many pairs of pixels is dropped:
what is printed in a cell, or beside an edge, is finer than the cell and more blurred."""

MOST_SADDLES = 4000
"""The strongest are kept: 30 boards of 10 x 10 cells. It bounds time and memory in a picture of
gravel or grass."""

MARGIN = 6
"""Pixels at the border in which no saddle is looked for: the filters' and the rivals' reach."""

STRIP = 512
"""Rows of a picture that are searched at a time, which bounds the memory that filters take."""


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """Saddle points of one picture.

    Attributes
    ----------
    points : ndarray of float64, shape (N, 2)
        In pixels of the searched picture, good to some tenths.
    edges : ndarray of float64, shape (N, 2, 2)
        Unit vectors along the two edges that cross: clockwise (on the screen) of the first it is
        dark, and of the second, which comes next clockwise, light.
    """

    points: FloatArray
    edges: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Saddles:
        """Return the saddles that a mask or index array selects."""
        return Saddles(self.points[keep], self.edges[keep])


def find_saddles(picture: NDArray[np.uint8]) -> Saddles:
    """Find the saddle points of a grey picture whose four sectors alternate, each once."""
    pixels, strengths = _peaks(picture)
    if len(pixels) > MOST_SADDLES:
        pixels = pixels[np.argsort(-strengths)[:MOST_SADDLES]]
    offset, curvature = _core.saddle_steps(picture, pixels)
    gap, even = np.abs(offset).max(axis=1), _is_even(curvature)
    near = even & (gap < MAX_OFFSET)
    points = pixels[near] + offset[near]
    drawn = even & ~near & (gap < FAR_OFFSET)
    if drawn.any():
        beside = _settled_beside(picture, pixels[drawn] + offset[drawn], points)
        points = np.concatenate([points, beside])
    return _crossings(picture, points)


def _settled_beside(
    picture: NDArray[np.uint8], points: FloatArray, others: FloatArray
) -> FloatArray:
    """Those points, shape (N, 2), that are one step from a saddle which no other one is on."""
    pixels = np.rint(points).astype(np.intp)
    _, first = np.unique(pixels, axis=0, return_index=True)
    pixels = pixels[np.sort(first)]
    taken = np.zeros(picture.shape, np.uint8)
    x, y = np.rint(others).astype(np.intp).T
    taken[y, x] = 1
    free = cv2.dilate(taken, np.ones((3, 3), np.uint8))[pixels[:, 1], pixels[:, 0]] == 0
    offset, curvature = _core.saddle_steps(picture, pixels[free])
    arrived = (np.abs(offset).max(axis=1, initial=0.0) < ARRIVED) & _is_even(curvature)
    return np.asarray(pixels[free][arrived] + offset[arrived], np.float64)


def _peaks(picture: NDArray[np.uint8]) -> tuple[NDArray[np.intp], FloatArray]:
    """Pixels (N, 2) where the saddle is strongest in their neighbourhood, and how strong."""
    height, width = picture.shape
    places, strengths = [np.zeros(0, np.intp)], [np.zeros(0, np.float32)]
    for top in range(0, height, STRIP):
        first = max(top - MARGIN, 0)
        pixels, strong = _peaks_of_strip(picture[first : top + STRIP + MARGIN])
        own = (pixels >= (top - first) * width) & (pixels < (top - first + STRIP) * width)
        places.append(pixels[own] + first * width)
        strengths.append(strong[own])
    y, x = np.divmod(np.concatenate(places), width)
    inside = (x >= MARGIN) & (x < width - MARGIN) & (y >= MARGIN) & (y < height - MARGIN)
    strength = np.concatenate(strengths)[inside].astype(np.float64)
    return np.stack([x[inside], y[inside]], axis=1), strength


def _peaks_of_strip(strip: NDArray[np.uint8]) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Flat indices of the peaks, and their strengths."""
    strength = _strength(strip)
    highest = cv2.dilate(strength, np.ones((3, 3), np.uint8))
    flat = strength.ravel()
    found = np.flatnonzero(flat > (FILTER_GAIN * MIN_SADDLE) ** 2)
    found = found[flat[found] >= highest.ravel()[found]]
    # The strongest of each 3 x 3 pixels is known: every second of them tells of all.
    rival = cv2.dilate(highest[::2, ::2], np.ones((RIVAL_WINDOW, RIVAL_WINDOW), np.uint8))
    y, x = np.divmod(found, strip.shape[1])
    found = found[flat[found] >= LEAST_OF_RIVAL**2 * rival[y // 2, x // 2]]
    return found, flat[found]


def _strength(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Negative determinant of the second derivatives, times the square of `FILTER_GAIN`."""
    xx = cv2.Sobel(picture, cv2.CV_32F, 2, 0, ksize=APERTURE)
    yy = cv2.Sobel(picture, cv2.CV_32F, 0, 2, ksize=APERTURE)
    xy = cv2.Sobel(picture, cv2.CV_32F, 1, 1, ksize=APERTURE)
    cv2.multiply(xx, yy, dst=xx)
    cv2.multiply(xy, xy, dst=xy)
    return np.asarray(cv2.subtract(xy, xx, dst=xy), dtype=np.float32)


def settle(picture: NDArray[np.uint8], points: FloatArray) -> FloatArray:
    """Move points, shape (N, 2), onto the saddle next to them where there is one."""
    return _core.settle_on_saddles(picture, points)


def _is_even(curvature: FloatArray) -> NDArray[np.bool_]:
    """Whether the second derivatives, shape (N, 4), are those of a saddle as steep both ways."""
    trace = curvature[:, 0] + curvature[:, 2]
    return np.asarray(trace**2 <= (MOST_UNEVEN - 1.0) ** 2 / MOST_UNEVEN * -curvature[:, 3])


def _crossings(picture: NDArray[np.uint8], points: FloatArray) -> Saddles:
    """Keep the saddles round which two light sectors and two dark ones alternate.

    Each pair of opposite ones is much alike. The second derivatives would tell where the sectors
    are, but not how wide: smoothed, every crossing of two edges has them as if at right angles.
    """
    around = points[:, None] + RING * _DIRECTIONS
    shades = sample(picture, around)
    opposite = shades.reshape(len(points), 2, HALF_TURN)
    mean = 0.5 * (opposite[:, 0] + opposite[:, 1])
    light, dark = mean.argmax(axis=1), mean.argmin(axis=1)
    every = np.arange(len(points))
    lightest, darkest = opposite[every, :, light], opposite[every, :, dark]
    step = mean[every, light] - mean[every, dark]
    level = 0.5 * (mean[every, light] + mean[every, dark])
    alternate = lightest.min(axis=1) - darkest.max(axis=1) > MIN_ALTERNATION * step
    if not alternate.any():  # as in a picture of squares
        return Saddles(points[:0], np.empty((0, 2, 2)))

    above = mean - level[:, None]
    falls, rises = _signs(above)
    keep = alternate & (np.count_nonzero(falls, axis=1) == 1) & (step > 0.0)
    first, second = (
        (turn.argmax(axis=1) + _parts(above)[every, turn.argmax(axis=1)])[keep]
        for turn in (falls, rises)
    )
    turned = _edges_afar(picture, points[keep], np.stack([first, second], axis=1), step[keep])
    turned *= np.pi / HALF_TURN
    first, second = turned.T % np.pi
    second = np.where(second < first, second + np.pi, second)
    turned = np.stack([first, second], axis=1)
    return Saddles(points[keep], np.stack([np.cos(turned), np.sin(turned)], axis=2))


def _signs(above: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where rings, shape (N, HALF_TURN), fall to below zero, and where they rise above it."""
    here, next_one = above > 0.0, np.roll(above, -1, axis=1) > 0.0
    return here & ~next_one, ~here & next_one


def _parts(above: FloatArray) -> FloatArray:
    """How far from each direction of rings, shape (N, HALF_TURN), to the next one they are zero."""
    gap = above - np.roll(above, -1, axis=1)
    return np.asarray(above / np.where(gap == 0.0, 1.0, gap))


def _edges_afar(
    picture: NDArray[np.uint8], points: FloatArray, turned: FloatArray, step: FloatArray
) -> FloatArray:
    """Directions of the edges, shape (N, 2), as a wider ring has them where it shows both.

    Where edges cross aslant, blur turns what is near of them toward a right angle.
    """
    shades = sample(picture, points[:, None] + FAR_RING * _DIRECTIONS)
    mean = shades.reshape(len(points), 2, HALF_TURN).mean(axis=1)
    level = 0.5 * (mean.max(axis=1) + mean.min(axis=1))
    above = mean - level[:, None]
    places = np.arange(HALF_TURN) + _parts(above)
    beside = np.roll(above, 1, axis=1) - np.roll(above, -2, axis=1)
    every = np.arange(len(points))
    found = turned.copy()
    good = np.ones(len(points), bool)
    for number, turn in enumerate(_signs(above)):
        gap = places - turned[:, number, None]
        gap -= HALF_TURN * np.rint(gap / HALF_TURN)
        edge = turn & (np.abs(beside) > LEAST_EDGE * step[:, None])
        gap = np.where(edge, gap, np.inf)
        nearest = np.abs(gap).argmin(axis=1)
        good &= np.abs(gap[every, nearest]) < MOST_TURNED * HALF_TURN / np.pi
        found[:, number] += np.where(good, gap[every, nearest], 0.0)
    return np.where(good[:, None], found, turned)
