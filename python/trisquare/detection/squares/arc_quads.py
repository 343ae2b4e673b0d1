"""Quads of smooth edges: rectangles whose contour runs into the things around them.

No threshold separates a sheet from something equally light that touches it, but most of each of its
sides is still an edge. Edges are followed as arcs, with the lighter side on one hand; arcs
that continue one another are joined, and four that meet at corners make a quad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.detection.candidates import MIN_CONTRAST
from trisquare.detection.sampling import sample
from trisquare.detection.squares.quads import (
    BORDER,
    CLEARANCE,
    FRACTIONS,
    MIN_SIDE,
    POINTS_PER_SIDE,
    Quads,
)

WEAKEST, STRONGEST = 2.5, 5.0
"""Minimum gradients of an edge, everywhere and at its strongest point, grey levels per pixel; a
step of `MIN_CONTRAST` rises over 3 pixels."""

TOLERANCE = 0.6
"""Maximum deviation from an arc, pixels, of the mean of a few edge points."""

SMALLEST_RADIUS = 0.275
"""Minimum radius of an arc over the picture's diagonal; only stronger fisheyes bend a side more."""

MAX_ARCS = 250
"""Maximum number of arcs; the longest are used."""

JOINED_TURN = 0.2
JOINED_OFFSET = (1.5, 0.06)
"""Maximum angle between two arcs of one side, radians, and maximum distance of one from the other's
continuation, in pixels plus a fraction of the gap: a side that bends by 4 % turns by 0.3 from end
to end."""

MAX_JOINED = 6
"""Maximum number of arcs of one side: five interruptions."""

MIN_CORNER_SINE = np.sin(np.deg2rad(25.0))
"""Minimum sine of a corner's angle: corners between 25 and 155 degrees."""

OVERRUN = 4.0
"""Maximum distance, in pixels, by which an edge continues beyond a corner, along something else."""

MIN_COVERED = 0.35
"""Minimum fraction of a side that its arcs cover, and that shows an edge: what lies beside it may
be as light as the figure, or lighter."""

MAX_GAP = 1.0 / MIN_COVERED - 1.0
"""Maximum gap between arcs and beyond them, over their length."""

MAX_QUADS = 150
"""Maximum number of quads of each polarity, those that are covered best."""


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Edges that may be sides: single arcs, and arcs that continue one another."""

    points: list[FloatArray]
    starts: FloatArray  # (S, 2)
    ends: FloatArray  # (S, 2)
    leaving: FloatArray  # (S, 2), unit tangent at the start
    arriving: FloatArray  # (S, 2), unit tangent at the end
    arc_lengths: FloatArray  # (S,), length of the arcs

    @classmethod
    def of(cls, arcs: list[FloatArray]) -> _Edges:
        """Build edges from single arcs."""
        tangents = np.array([_tangents(arc) for arc in arcs]).reshape(-1, 2, 2)
        starts = np.array([arc[0] for arc in arcs]).reshape(-1, 2)
        ends = np.array([arc[-1] for arc in arcs]).reshape(-1, 2)
        arc_lengths = np.linalg.norm(ends - starts, axis=1)
        return cls(arcs, starts, ends, tangents[:, 0], tangents[:, 1], arc_lengths)

    def joined(self) -> _Edges:
        """Return all runs of edges in which each is the nearest that continues the one before."""
        gaps = self.starts[None] - self.ends[:, None]  # (S, S, 2), from one to the next
        distances = np.linalg.norm(gaps, axis=-1)
        max_offsets = JOINED_OFFSET[0] + JOINED_OFFSET[1] * distances
        turns = np.abs(_cross(self.arriving[:, None], self.leaving[None]))
        is_ahead = np.einsum("ij,ikj->ik", self.arriving, gaps) > -OVERRUN
        is_ahead &= np.einsum("ij,kj->ik", self.arriving, self.leaving) > 0.0
        continues = (
            is_ahead
            & (turns <= JOINED_TURN)
            & (np.abs(_cross(self.arriving[:, None], gaps)) <= max_offsets)
            & (np.abs(_cross(self.leaving[None], gaps)) <= max_offsets)
            & (distances <= MAX_GAP * (self.arc_lengths[:, None] + self.arc_lengths[None]))
        )
        np.fill_diagonal(continues, False)
        distances[~continues] = np.inf
        following = np.where(continues.any(axis=1), distances.argmin(axis=1), -1).tolist()
        runs: list[list[int]] = []
        for number in range(len(self.points)):
            run = [number]
            runs.append(run)
            while len(run) < MAX_JOINED and (next_edge := following[run[-1]]) not in (-1, *run):
                run = [*run, next_edge]
                runs.append(run)
        first = np.array([run[0] for run in runs], np.intp)
        last = np.array([run[-1] for run in runs], np.intp)
        return _Edges(
            [np.concatenate([self.points[i] for i in run]) for run in runs],
            self.starts[first],
            self.ends[last],
            self.leaving[first],
            self.arriving[last],
            np.array([self.arc_lengths[run].sum() for run in runs]),
        )

    def corners(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return where each edge's end meets each other's start, (S, S, 2), and if it does."""
        sines = _cross(self.arriving[:, None], self.leaving[None])
        is_corner = sines >= MIN_CORNER_SINE
        gaps = self.starts[None] - self.ends[:, None]
        safe_sines = np.where(is_corner, sines, 1.0)
        end_extensions = _cross(gaps, self.leaving[None]) / safe_sines
        start_extensions = _cross(self.arriving[:, None], gaps) / safe_sines
        reach = MAX_GAP * self.arc_lengths + OVERRUN
        is_corner &= (end_extensions >= -OVERRUN) & (end_extensions <= reach[:, None])
        is_corner &= (start_extensions >= -OVERRUN) & (start_extensions <= reach[None])
        places = self.ends[:, None] + end_extensions[..., None] * self.arriving[:, None]
        return places, is_corner


def find_arc_quads(smooth: NDArray[np.float32]) -> Quads:
    """Find quads whose sides are for the most part smooth edges.

    Parameters
    ----------
    smooth : ndarray of float32, shape (H, W)

    Returns
    -------
    Quads
        Of both polarities, those with the most edge first; several may show one outline.
    """
    arcs = _core.find_arcs(
        np.ascontiguousarray(smooth),
        WEAKEST,
        STRONGEST,
        TOLERANCE,
        int(MIN_SIDE),
        SMALLEST_RADIUS * float(np.hypot(*smooth.shape)),
    )
    arcs = sorted(arcs, key=len, reverse=True)[:MAX_ARCS]
    light = _four_sided(arcs, smooth.shape)
    dark = _four_sided([arc[::-1] for arc in arcs], smooth.shape)
    dark_inside = np.arange(len(light) + len(dark)) >= len(light)
    quads = Quads.rough(np.concatenate([light, dark]), dark_inside)
    shares = edge_shares(smooth, quads)
    order = np.argsort(-shares.mean(axis=1), kind="stable")
    order = order[shares.min(axis=1, initial=1.0)[order] >= MIN_COVERED]
    return quads.subset(order)


def edge_shares(smooth: NDArray[np.float32], quads: Quads) -> FloatArray:
    """Return the fraction of each side's points with an edge of the quad's own sign, (Q, 4)."""
    across = CLEARANCE * quads.normals[:, :, None]
    steps = sample(smooth, quads.sides + across) - sample(smooth, quads.sides - across)
    steps *= np.where(quads.dark_inside, 1.0, -1.0)[:, None, None]
    return np.asarray((steps >= MIN_CONTRAST).mean(axis=2))


def _four_sided(arcs: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Return the sides of all quads made of edges, clockwise, (Q, 4, POINTS_PER_SIDE, 2)."""
    if len(arcs) < 4:
        return np.empty((0, 4, POINTS_PER_SIDE, 2))
    edges = _Edges.of(arcs).joined()
    places, is_corner = edges.corners()
    size = np.array(shape[::-1])
    is_corner &= ((places >= BORDER) & (places < size - BORDER)).all(axis=-1)
    # Sides between two corners: (before, itself, after).
    sides: dict[tuple[int, int], list[int]] = {}
    for side in range(len(edges.points)):
        before, after = np.flatnonzero(is_corner[:, side]), np.flatnonzero(is_corner[side])
        chords = places[side, after][None] - places[before, side][:, None]
        lengths = np.linalg.norm(chords, axis=-1)
        is_covered = (lengths >= MIN_SIDE) & (edges.arc_lengths[side] >= MIN_COVERED * lengths)
        is_covered &= chords @ (edges.ends[side] - edges.starts[side]) > 0.0
        for i, k in np.argwhere(is_covered).tolist():
            sides.setdefault((int(before[i]), int(after[k])), []).append(side)
    is_side = {(a, b, c) for (a, c), middle in sides.items() for b in middle}
    found = [
        (a, b, c, d)
        for (a, c), middle in sides.items()
        if a < c
        for d in sides.get((c, a), ())
        for b in middle
        if a < min(b, d) and (b, c, d) in is_side and (d, a, b) in is_side
    ]
    quads = np.array(found, np.intp).reshape(-1, 4)
    corners = places[np.roll(quads, 1, axis=1), quads]
    perimeters = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1).sum(axis=1)
    order = np.argsort(-edges.arc_lengths[quads].sum(axis=1) / perimeters, kind="stable")[
        :MAX_QUADS
    ]
    sampled = [
        [
            _sampled(edges.points[edge], start, end)
            for edge, start, end in zip(
                quad, quad_corners, np.roll(quad_corners, -1, axis=0), strict=True
            )
        ]
        for quad, quad_corners in zip(quads[order], corners[order], strict=True)
    ]
    return np.array(sampled).reshape(-1, 4, POINTS_PER_SIDE, 2)


def _sampled(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return points of a side at `FRACTIONS` of its chord, along its edge where that is visible."""
    chord = end - start
    length = np.hypot(*chord)
    outward = np.array([chord[1], -chord[0]]) / length
    along = (points - start) @ chord / length**2
    is_between = (along > 0.0) & (along < 1.0)
    order = np.argsort(along[is_between])
    places = np.concatenate([[0.0], along[is_between][order], [1.0]])
    offsets = np.concatenate([[0.0], ((points - start) @ outward)[is_between][order], [0.0]])
    return np.asarray(
        start
        + FRACTIONS[:, None] * chord
        + np.interp(FRACTIONS, places, offsets)[:, None] * outward
    )


def _tangents(arc: FloatArray) -> FloatArray:
    """Return unit tangents at both ends of an arc, shape (2, 2), by the parabola over its chord."""
    chord = arc[-1] - arc[0]
    length = np.hypot(*chord)
    along, across = chord / length, np.array([-chord[1], chord[0]]) / length
    place = (arc - arc[0]) @ along / length
    height = place * (1.0 - place)
    slope = height @ ((arc - arc[0]) @ across / length) / (height @ height)
    tangents = along + np.array([[slope], [-slope]]) * across
    return np.asarray(tangents / np.linalg.norm(tangents, axis=1, keepdims=True))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
