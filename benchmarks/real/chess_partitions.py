"""Spread of K over disjoint triples of photographs of a chessboard, relative to its stated std."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from harness.rows import Row
from harness.truth import MAD_TO_STD, PINHOLE

import trisquare as ts

PARTITIONS = 100
SEED = 11
PICTURES_EACH = 3
FACTOR_TARGET = 2.0
TOGETHER = "have a common error"
"""Words of the warning that the stated std was raised because boards are not flat."""


def partition_row(boards: Sequence[list[ts.PlaneEdges]], image_size: tuple[int, int]) -> Row:
    """Print the spread of K over disjoint triples and its stated std, by parameter.

    The spread is robust and about the median over all triples, because the truth is unknown. Each
    triple's deviation is divided by its own std, because some triples determine K much better than
    others.
    """
    found: list[ts.Calibration] = []
    for triple in disjoint_triples(len(boards)):
        edges = pooled(boards[index] for index in triple)
        try:
            found.append(ts.calibrate_edges(edges, image_size))
        except ts.TrisquareError as error:
            print(f"  boards {list(triple)} refused: {error}")
    K = np.array([[getattr(result.camera, name) for name in PINHOLE] for result in found])
    std = np.array([[result.std[name] for name in PINHOLE] for result in found])
    off = K - np.median(K, axis=0)
    spread = MAD_TO_STD * np.median(np.abs(off), axis=0)
    ratios = MAD_TO_STD * np.median(np.abs(off / std), axis=0)
    for name, own, stated, ratio in zip(
        PINHOLE, spread, np.median(std, axis=0), ratios, strict=True
    ):
        print(
            f"  {name}: spread {own:.2f} px, median std {stated:.2f} px; in its own std {ratio:.2f}"
        )
    warned = sum(any(TOGETHER in text for text in result.warnings) for result in found)
    print(f"  {warned} of {len(found)} triples warn that the samples of a side {TOGETHER}")
    worst = float(np.max(np.maximum(ratios, 1.0 / ratios)))
    return Row(
        f"{len(found)} disjoint triples: robust spread / std of fx, fy, cx, cy; warned",
        f"{', '.join(f'{ratio:.2f}' for ratio in ratios)}; {warned / len(found):.0%}",
        f"within a factor of {FACTOR_TARGET:.0f}",
        worst <= FACTOR_TARGET,
    )


def disjoint_triples(count: int) -> Iterator[tuple[int, ...]]:
    """Yield the triples of random partitions, without remainders."""
    rng = np.random.default_rng(SEED)
    for _ in range(PARTITIONS):
        order = rng.permutation(count).tolist()
        for start in range(0, count - PICTURES_EACH + 1, PICTURES_EACH):
            yield tuple(sorted(order[start : start + PICTURES_EACH]))


def pooled(pictures: Iterable[list[ts.PlaneEdges]]) -> list[ts.PlaneEdges]:
    """Pool the planes of several pictures, numbered as those of one calibration."""
    return [
        replace(figure, image=image, plane=image)
        for image, figures in enumerate(pictures)
        for figure in figures
    ]
