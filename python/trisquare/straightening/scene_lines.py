"""Lines of a picture beside its targets, for a joint calibration with these."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.edges import PlaneEdges
from trisquare.images.pixels import Image, picture_size
from trisquare.straightening.edges import find_arcs
from trisquare.straightening.fit import Problem, fit_lens
from trisquare.straightening.straighten import LONG, MIN_LINES

MAX_LINES = 60
"""Maximum number of lines, the longest ones: the core's time grows with the square of this."""

ECHO_DISTANCE = 0.015
"""Distance, in half diagonals, within which most of a line runs beside a longer one: the two sides
of one edge bend together, and would count twice."""

MARGIN, BOARD_MARGIN = 1.1, 1.5
"""Extent of a figure's region over that of its samples: larger for a board, whose outermost cells
lie beyond its grid lines' crossings."""

MAX_INSIDE = 0.1
"""Maximum fraction of an arc within such a region."""


def background_lines(picture: Image, figures: Sequence[PlaneEdges]) -> list[PlaneEdges]:
    """Return the long edges of a picture that belong to none of its measured figures.

    They may be images of straight lines or not; the calibration decides which are.

    Parameters
    ----------
    picture : ndarray
    figures : sequence of PlaneEdges
        Figures of this picture.
    """
    width, height = size = picture_size(picture)
    radius = 0.5 * float(np.hypot(width, height))
    arcs = find_arcs(picture)
    hulls = [_hull(figure) for figure in figures]
    curves = tuple(curve for curve in arcs.curves if not _is_in_figure(curve, hulls))
    lines = list(curves)
    if len(curves) >= MIN_LINES:
        middle = 0.5 * (np.array(size, dtype=np.float64) - 1)
        lines = fit_lens(Problem(curves, middle, radius, arcs.pixel)).lines()
    long_lines = [line for line in lines if _length(line) >= LONG * radius]
    kept: list[FloatArray] = []
    for line in sorted(long_lines, key=_length, reverse=True):
        if not any(_is_echo(line, longer, ECHO_DISTANCE * radius) for longer in kept):
            kept.append(line)
    return [PlaneEdges.line(line) for line in kept[:MAX_LINES]]


def _length(line: FloatArray) -> float:
    return float(np.linalg.norm(line[-1] - line[0]))


def _is_echo(line: FloatArray, longer: FloatArray, distance: float) -> bool:
    """Return whether at least half of a line's points lie near a longer one."""
    start, along = longer[:-1], np.diff(longer, axis=0)
    offsets = line[:, None] - start
    lengths = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    places = np.clip(np.einsum("pij,ij->pi", offsets, along) / lengths, 0.0, 1.0)
    distances = np.linalg.norm(offsets - places[..., None] * along, axis=2).min(axis=1)
    return bool(np.median(distances) <= distance)


def _hull(figure: PlaneEdges) -> FloatArray:
    """Return corners of the convex region of a figure, pixels."""
    points = np.concatenate(figure.points)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    margin = MARGIN if len(figure.points) <= 4 else BOARD_MARGIN
    grown = middle + margin * (points - middle)
    return np.asarray(cv2.convexHull(grown.astype(np.float32))[:, 0])


def _is_in_figure(curve: FloatArray, hulls: Sequence[FloatArray]) -> bool:
    """Return whether more than a few points of a curve lie in one of the hulls."""
    for hull in hulls:
        is_inside = [cv2.pointPolygonTest(hull, point, False) >= 0 for point in curve.tolist()]
        if np.mean(is_inside) > MAX_INSIDE:
            return True
    return False
