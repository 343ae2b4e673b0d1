"""Time of a fit to 3,000 edge points, relative to the solvers of OpenCV and SciPy.

trisquare's result includes the covariance. SciPy solves the same problem.
"""

from __future__ import annotations

import cv2
import numpy as np
from harness.rows import Row
from harness.scipy_solve import ScipyProblem
from harness.stopwatch import alternated_medians
from harness.truth import Array, camera_vector

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene, TrueCamera

SCENES = 5
REPETITIONS = 9
SEED = 7
PER_SIDE = 250
BOARDS = 3
NOISE = 0.1  # pixels
OPENCV_TARGET, OPENCV_GOAL = 0.5, 0.2
SCIPY_TARGET = 1.0 / 60.0
MANY = 10  # factor on the number of points
MANY_TARGET = 5.0
SAME_MODEL = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
# Losses that differ far from the optimum move the estimate a little within its noise. The estimate
# of a different problem would be many standard deviations away.
SAME_ESTIMATE = 0.5


def measure() -> list[Row]:
    """Print the ratios of the solving times, medians over the scenes."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times = np.array([_times(np.random.default_rng([SEED, i])) for i in range(SCENES)])
    finally:
        cv2.setNumThreads(threads)
    ours, opencv, robust, plain, many = 1e3 * np.median(times, axis=0)
    by_opencv, by_robust, by_plain, by_many = np.median(times[:, [0]] / times[:, 1:], axis=0)
    print(f"  trisquare {ours:.2f} ms, cv2.calibrateCamera {opencv:.2f} ms")
    print("  least_squares, 2-point Jacobian, started from the linear method, not timed:")
    print(f"  robust loss (trf, huber) {robust:.0f} ms; least squares (lm, MINPACK) {plain:.0f} ms")
    return [
        Row(
            "time / time of `cv2.calibrateCamera` for 3 x 54 corners",
            f"{by_opencv:.2f} ({ours:.2f} ms / {opencv:.2f} ms)",
            f"<= {OPENCV_TARGET}, goal {OPENCV_GOAL}",
            by_opencv <= OPENCV_TARGET,
        ),
        Row(
            "time / time of `scipy.optimize.least_squares` with a robust loss",
            f"1/{1.0 / by_robust:.0f} (without robust loss: 1/{1.0 / by_plain:.0f})",
            f"<= 1/{1.0 / SCIPY_TARGET:.0f}",
            by_robust <= SCIPY_TARGET,
        ),
        Row(
            f"time for {MANY * 3},000 edge points / time for 3,000",
            f"{1.0 / by_many:.2f} ({many:.2f} ms / {ours:.2f} ms)",
            f"<= {MANY_TARGET:.0f}",
            1.0 / by_many <= MANY_TARGET,
        ),
    ]


def _times(rng: np.random.Generator) -> list[float]:
    """Return the seconds of trisquare, OpenCV, SciPy with either loss, and with many points."""
    scene = simulate.random_scene(rng)
    size = scene.camera.image_size
    edges = [_square(scene, number, rng) for number in range(len(scene.targets))]
    problem = ScipyProblem(edges)
    start = problem.start(ts.calibrate_edges(edges, size, method="linear"))
    result = ts.calibrate_edges(edges, size)
    _check_same_estimate(result, problem.solve(start).x)
    _check_same_estimate(result, problem.solve_robustly(start, NOISE).x)
    many = [_square(scene, number, rng, MANY * PER_SIDE) for number in range(len(edges))]
    objects, corners = _chessboards(scene.camera, rng)
    return alternated_medians(
        [
            lambda: ts.calibrate_edges(edges, size),
            lambda: cv2.calibrateCamera(objects, corners, size, None, None, flags=SAME_MODEL),
            lambda: problem.solve_robustly(start, NOISE),
            lambda: problem.solve(start),
            lambda: ts.calibrate_edges(many, size),
        ],
        REPETITIONS,
    )


def _square(
    scene: Scene, number: int, rng: np.random.Generator, per_side: int = PER_SIDE
) -> ts.PlaneEdges:
    """Sample every side of one square at `per_side` points."""
    corners = scene.targets[number].outlines()[0]
    fraction = (np.arange(per_side)[:, None] + 0.5) / per_side
    sides = [
        scene.image_points(number, start + fraction * (end - start))
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return ts.PlaneEdges.square([side + NOISE * rng.standard_normal(side.shape) for side in sides])


def _chessboards(camera: TrueCamera, rng: np.random.Generator) -> tuple[list[Array], list[Array]]:
    objects, corners = [], []
    for _ in range(BOARDS):
        scene = simulate.chessboard_scene(rng, camera)
        board = scene.targets[0].board_corners()
        points = scene.image_points(0, board) + NOISE * rng.standard_normal(board.shape)
        objects.append(np.column_stack([board, np.zeros(len(board))]).astype(np.float32))
        corners.append(points.astype(np.float32)[:, None])
    return objects, corners


def _check_same_estimate(result: ts.Calibration, solved: Array) -> None:
    deviations = np.array([result.std[name] for name in result.parameters])
    ours = camera_vector(result.camera.K, result.camera.distortion)
    apart = np.abs(ours - solved[: len(ours)]) / deviations
    if apart.max() > SAME_ESTIMATE:
        raise RuntimeError(f"SciPy solved another problem: {apart.max():.2f} std apart")
