"""Disjoint halves of pictures of real boards: their difference beside its stated deviation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from harness.rows import NotMeasurableError, Row
from harness.truth import PINHOLE, rms
from real.real_pictures import DATA

import trisquare as ts

SETS = {"opencv-chess": "left*.jpg", "charuco-cube/cam0": "*.jpg"}
LEAST_PICTURES = 10
SPLITS = 10
SEED = 17
RANGE = (0.7, 1.3)


def measure() -> list[Row]:
    """Print every set's differences of fx, fy, cx and cy in their stated deviations."""
    found, counted = [], 0
    for folder, pattern in SETS.items():
        paths = sorted((DATA / folder).glob(pattern))
        pictures = list(_boards(paths))
        if len(pictures) < LEAST_PICTURES:
            continue
        height, width = cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE).shape
        ratios = np.array(list(_differences(pictures, (width, height))))
        parts = ", ".join(f"{n} {rms(r):.2f}" for n, r in zip(PINHOLE, ratios.T, strict=True))
        print(f"  {folder}: {len(ratios)} splits of {len(pictures)} pictures, rms {parts}")
        found.append(rms(ratios))
        counted += len(ratios)
    if not found:
        raise NotMeasurableError("no ../shared/data")
    total = rms(np.array(found))
    each = ", ".join(f"{own:.2f}" for own in found)
    return [
        Row(
            f"difference of disjoint halves / its stated std, {len(found)} sets of real boards, "
            f"{counted} splits",
            f"{total:.2f} ({each})",
            f"{RANGE[0]}-{RANGE[1]}",
            RANGE[0] <= total <= RANGE[1],
        )
    ]


def _boards(paths: Sequence[Path]) -> Iterator[list[ts.PlaneEdges]]:
    """Yield the boards of every picture that shows any."""
    for path in paths:
        try:
            found = ts.detect(path)
        except ts.TrisquareError as error:
            print(f"  {path.name}: {error}")
            continue
        boards = [board for board in found if board.kind == "chessboard"]
        if boards:
            yield boards


def _differences(
    pictures: Sequence[list[ts.PlaneEdges]], size: tuple[int, int]
) -> Iterator[list[float]]:
    """Yield the differences of fx, fy, cx and cy between halves over their stated deviations."""
    rng = np.random.default_rng(SEED)
    half = len(pictures) // 2
    for _ in range(SPLITS):
        order = rng.permutation(len(pictures))
        try:
            one, other = (
                ts.calibrate_edges(_pooled([pictures[i] for i in part]), size)
                for part in (order[:half], order[half:])
            )
        except ts.TrisquareError as error:
            print(f"  a half is refused: {error}")
            continue
        yield [
            (getattr(one.camera, name) - getattr(other.camera, name))
            / np.hypot(one.std[name], other.std[name])
            for name in PINHOLE
        ]


def _pooled(pictures: Sequence[list[ts.PlaneEdges]]) -> list[ts.PlaneEdges]:
    numbered = [(image, board) for image, boards in enumerate(pictures) for board in boards]
    return [
        replace(board, image=image, plane=plane) for plane, (image, board) in enumerate(numbered)
    ]
