"""Three chessboards: time from a picture in memory to the result, relative to Canny.

Boards of 9 x 9 cells, one thread. OpenCV's search finds one board at most.
"""

from __future__ import annotations

import cv2
import numpy as np
from accuracy.lattice_bound import board_scene
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare import simulate

PICTURES = 3
REPETITIONS = 9
SEED = 22
SIZE = (1280, 1024)
INNER_CORNERS = 8  # boards of 9 x 9 cells
TARGET = 18.0


def measure() -> list[Row]:
    """Print the times of the whole, of its parts, and of OpenCV's search for one board."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times = np.median([_times(seed) for seed in range(PICTURES)], axis=0)
    finally:
        cv2.setNumThreads(threads)
    whole, measured, solved, one_board, canny = times.tolist()
    for name, seconds in (
        ("detection and measurement", measured),
        ("solution", solved),
        ("cv2.findChessboardCornersSB, which finds one board at most", one_board),
    ):
        print(f"  {name}: {1e3 * seconds:.1f} ms, {seconds / canny:.1f} Canny")
    ratio = whole / canny
    return [
        Row(
            "1280 x 1024 pixels: time / time of `cv2.Canny`",
            f"{ratio:.1f} ({1e3 * whole:.1f} ms; `cv2.findChessboardCornersSB` alone "
            f"{one_board / canny:.0f})",
            f"<= {TARGET:.0f}",
            ratio <= TARGET,
        )
    ]


def _times(seed: int) -> list[float]:
    rng = np.random.default_rng([SEED, seed])
    scene = board_scene(rng, INNER_CORNERS, SIZE)
    picture = simulate.render(scene, rng, noise=2.0, blur=0.8, tone="srgb")
    edges = ts.detect(picture)
    pattern = (INNER_CORNERS, INNER_CORNERS)
    return alternated_medians(
        [
            lambda: ts.calibrate(picture),
            lambda: ts.detect(picture),
            lambda: ts.calibrate_edges(edges, SIZE),
            lambda: cv2.findChessboardCornersSB(picture, pattern),
            lambda: cv2.Canny(picture, 50, 150),
        ],
        REPETITIONS,
    )
