"""Measuring what was found: OpenCV finds the outlines, Rust measures their sides."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from trisquare import _core
from trisquare.detect import Targets
from trisquare.edge_shift import shift_toward_light, without_shift
from trisquare.edges import PlaneEdges
from trisquare.outlines import BoardOutline, Outline, find_chessboard, find_squares, grey_bytes
from trisquare.picture_tone import PictureTone
from trisquare.pictures import Image

FloatArray: TypeAlias = npt.NDArray[np.float64]
Span: TypeAlias = tuple[FloatArray, float, tuple[int | None, int | None]]
Samples: TypeAlias = tuple[FloatArray, FloatArray, FloatArray | None]

BOARD_PROBE = 0.25
"""Distance from a grid line, in cells, at which a cell's shade is looked up."""


class Measurement(NamedTuple):
    """What was measured in a picture: the list may be empty."""

    figures: list[PlaneEdges]
    tone: PictureTone


def measure(
    picture: Image, core: _core.Picture, targets: Targets, tone: str | float
) -> Measurement:
    """Find the targets in a checked picture and measure them."""
    if targets.board is not None:
        outline = find_chessboard(picture, *targets.board)
        if outline is None:
            return Measurement([], PictureTone.known(tone))
        return _measure_board(picture, core, outline, tone)
    return _measure_squares(picture, core, tone)


def _localise(
    core: _core.Picture, spans: list[Span], tone: str | float
) -> tuple[list[Samples | str], PictureTone]:
    """Measure spans, and the tone curve where that is to be estimated."""
    measured, estimate = _core.localise(core, spans, None if tone == "auto" else tone)
    if estimate is None:
        return measured, PictureTone.known(tone)
    return measured, PictureTone.estimated(estimate)


def _measure_squares(picture: Image, core: _core.Picture, tone: str | float) -> Measurement:
    squares = find_squares(picture)
    spans: list[Span] = []
    for square in squares:
        for outline in (square.outer, square.inner):
            spans += _outline_spans(outline, len(spans)) if outline is not None else []
    localised, picture_tone = _localise(core, spans, tone)
    measured = iter(localised)
    figures = []
    for plane, square in enumerate(squares):
        kind = "square" if square.inner is None else "frame"
        for outline in (square.outer, square.inner):
            sides = [] if outline is None else [next(measured) for _ in range(4)]
            samples = [side for side in sides if not isinstance(side, str)]
            # An outline with a side that is no edge is no square; without its outer outline, a
            # frame's inner one is a square of its own.
            if outline is not None and len(samples) == 4:
                figures.append(_square_edges(outline, samples, plane, kind))
    return Measurement(figures, picture_tone)


def _outline_spans(outline: Outline, first: int) -> list[Span]:
    rise = -1.0 if outline.dark_inside else 1.0
    return [
        (np.ascontiguousarray(side), rise, (first + (i + 3) % 4, first + (i + 1) % 4))
        for i, side in enumerate(outline.sides)
    ]


def _square_edges(outline: Outline, sides: list[Samples], plane: int, kind: str) -> PlaneEdges:
    edges = PlaneEdges.square(
        [points for points, _, _ in sides],
        [std for _, std, _ in sides],
        polarity=1 if outline.dark_inside else -1,
        plane=plane,
        kind=kind,
        freedom="size" if kind == "frame" else "auto",
    )
    drift = tuple(drift for _, _, drift in sides if drift is not None)
    return replace(edges, drift=drift) if drift else edges


def _measure_board(
    picture: Image, core: _core.Picture, outline: BoardOutline, tone: str | float
) -> Measurement:
    corners = outline.corners
    rows, cols = (int(count) for count in corners.shape[:2])
    # Spans between neighbouring corners: along the rows first, then along the columns.
    along = [(r, c, r, c + 1) for r in range(rows) for c in range(cols - 1)]
    down = [(r, c, r + 1, c) for c in range(cols) for r in range(rows - 1)]

    def crossing_down(r: int, c: int) -> int:
        return len(along) + c * (rows - 1) + min(r, rows - 2)

    def crossing_along(r: int, c: int) -> int:
        return r * (cols - 1) + min(c, cols - 2)

    bounds = [(crossing_down(r, c), crossing_down(r, c + 1)) for r, c, _, _ in along]
    bounds += [(crossing_along(r, c), crossing_along(r + 1, c)) for r, c, _, _ in down]
    paths = [np.stack([corners[r0, c0], corners[r1, c1]]) for r0, c0, r1, c1 in along + down]
    rises = _rises(grey_bytes(picture), np.stack(paths))
    spans: list[Span] = list(zip(paths, rises, bounds, strict=True))
    measured, picture_tone = _localise(core, spans, tone)

    lines = [(0.0, 1.0, (rows - 1) / 2 - r) for r in range(rows)]
    lines += [(1.0, 0.0, (cols - 1) / 2 - c) for c in range(cols)]
    split = len(along)
    signed = list(zip(measured, rises, strict=True))
    chains = [signed[r * (cols - 1) : (r + 1) * (cols - 1)] for r in range(rows)]
    chains += [signed[split + c * (rows - 1) :][: rows - 1] for c in range(cols)]
    joined = [samples for samples in map(_joined, chains) if samples is not None]
    if len(joined) < len(lines):
        return Measurement([], picture_tone.of_board())
    # The board's own zigzag tells the shift that a tone curve leaves, far better than profiles
    # do: there is no drift to account for.
    shift = shift_toward_light(joined)
    board = PlaneEdges(
        np.array(lines),
        tuple(without_shift(points, signs, shift) for points, _, signs in joined),
        tuple(std for _, std, _ in joined),
        plane=0,
        kind="chessboard",
    )
    return Measurement([board], picture_tone.of_board())


def _joined(
    chain: Iterable[tuple[Samples | str, float]],
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return points, standard deviations and rises of all measured spans of one grid line."""
    samples = [(*span[:2], rise) for span, rise in chain if not isinstance(span, str)]
    if not samples:
        return None
    points, std, rises = zip(*samples, strict=True)
    signs = np.repeat(rises, [len(part) for part in points])
    return np.concatenate(points), np.concatenate(std), signs


def _rises(grey: npt.NDArray[np.uint8], paths: FloatArray) -> list[float]:
    """Return +1 for spans with the lighter cell on their right-hand normal's side, else -1.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    paths : ndarray, shape (S, 2, 2)
        Start and end of each span, pixels.
    """
    middle = paths.mean(axis=1)
    along = paths[:, 1] - paths[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) * BOARD_PROBE
    probes = np.stack([middle + normal, middle - normal], axis=1).astype(np.float32)
    shades = cv2.remap(grey, probes[..., 0], probes[..., 1], cv2.INTER_LINEAR).astype(np.int64)
    return [1.0 if right > left else -1.0 for right, left in shades.tolist()]
