"""Undistorting pictures and points: agreement with OpenCV, and time.

Pixels beyond the valid radius of a camera are left out. `Undistorter` also makes the new camera and
the mask of valid pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from harness.rows import Row
from harness.stopwatch import alternated_medians
from harness.truth import Array

import trisquare as ts

SEED = 29
CAMERAS = 60
SIZE = (640, 480)
GREY_LEVELS = 1

FRAME_SIZE = (1920, 1080)
POINTS = 20_000
REPETITIONS = 9

POINT_TARGET = 1e-9  # pixels

# OpenCV 5 merged the two functions.
ITERATE = getattr(cv2, "undistortPointsIter", None) or cv2.undistortPoints
# Termination criteria for OpenCV's inverse to be exact: iterated until nothing changes.
EXACT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 1000, 1e-15)


def measure() -> list[Row]:
    """Print agreement, inverses and times; times are on one thread, alternated."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return [*_agreement(), *_inverse(), *_frame_time(), *_point_time()]
    finally:
        cv2.setNumThreads(threads)


def random_camera(rng: np.random.Generator, size: tuple[int, int]) -> ts.Camera:
    """Draw a lens of up to 50 degrees off the axis, with strong distortion in the corners."""
    fx, aspect = rng.uniform(0.5, 2.0) * size[0], rng.uniform(0.8, 1.25)
    cx, cy = rng.normal(np.array(size) / 2, 0.05 * np.array(size))
    reach = np.hypot(*size) / 2 / fx
    k1, k2, k3 = rng.uniform(-0.5, 0.5, 3) / reach ** np.array([2, 4, 6])
    p1, p2 = rng.uniform(-0.05, 0.05, 2) / reach
    K = np.array([[fx, 0.0, cx], [0.0, aspect * fx, cy], [0.0, 0.0, 1.0]])
    return ts.Camera(K, [k1, k2, p1, p2, k3], size, "brown")


def _agreement() -> list[Row]:
    """Return the largest difference of undistorted noise pictures within the valid radius."""
    rng = np.random.default_rng(SEED)
    worst, black = 0.0, 0
    for number in range(CAMERAS):
        camera = random_camera(rng, SIZE)
        shape = (SIZE[1], SIZE[0], 3) if number % 2 else SIZE[::-1]
        picture = rng.integers(0, 256, shape, dtype=np.uint8)
        for balance in (0.0, rng.random(), 1.0):
            view = camera.undistorted(balance)
            found = ts.undistort(picture, camera, balance)
            K, distortion = camera.K.copy(), camera.distortion.copy()
            expected = cv2.undistort(picture, K, distortion, None, view.K.copy())
            difference = np.abs(found.astype(int) - expected)[_within(camera, view)]
            worst = max(worst, float(difference.max(initial=0)))
        black += int((~ts.Undistorter(camera, 0.0).valid_mask).sum())
    return [
        Row(
            f"pictures of noise, {CAMERAS} cameras: largest difference from `cv2.undistort`",
            f"{worst:.0f} levels",
            f"{GREY_LEVELS} level",
            worst <= GREY_LEVELS,
        ),
        Row(f"balance 0, {CAMERAS} cameras: black pixels", str(black), "0", black == 0),
    ]


def _within(camera: ts.Camera, view: ts.Camera) -> Array:
    """Return which pixels of a view are within the valid radius; OpenCV folds others back."""
    y, x = np.indices(view.image_size[::-1])
    radius = np.hypot((x - view.cx) / view.fx, (y - view.cy) / view.fy)
    limit = np.inf if camera.valid_radius is None else camera.valid_radius
    return np.asarray(radius <= limit)


def _inverse() -> list[Row]:
    """Return the largest error of pixels undistorted and distorted again."""
    rng = np.random.default_rng(SEED + 1)
    worst, count = 0.0, 0
    for _ in range(10 * CAMERAS):
        camera = random_camera(rng, SIZE)
        limit = np.hypot(*SIZE) if camera.valid_radius_px is None else camera.valid_radius_px
        pixels = rng.uniform(0, np.array(SIZE) - 1, (1000, 2))
        centre = [camera.cx, camera.cy]
        pixels = pixels[np.linalg.norm(pixels - centre, axis=1) < limit]
        ideal, rays = camera.undistort_points(pixels), camera.unproject(pixels)
        for back in (camera.distort_points(ideal), camera.project(rays)):
            worst = max(worst, float(np.abs(back - pixels).max(initial=0.0)))
        count += len(pixels)
    return [
        Row(
            f"{10 * CAMERAS} cameras, {count} points: largest error of undistorting and distorting",
            f"{worst:.1e} px",
            f"{POINT_TARGET:.0e} px",
            worst <= POINT_TARGET,
        )
    ]


def _frame_time() -> list[Row]:
    """Compare the times of a video frame, and of the maps made for the first frame."""
    camera = _usual_camera(FRAME_SIZE)
    rng = np.random.default_rng(SEED + 2)
    frame = rng.integers(0, 256, (FRAME_SIZE[1], FRAME_SIZE[0], 3), dtype=np.uint8)
    undistorter = ts.Undistorter(camera)
    K, distortion = camera.K.copy(), camera.distortion.copy()
    view = undistorter.new_camera.K.copy()
    ours, theirs, our_maps, their_maps = alternated_medians(
        [
            lambda: undistorter.undistort(frame),
            lambda: cv2.undistort(frame, K, distortion, None, view),
            lambda: ts.Undistorter(camera),
            lambda: cv2.initUndistortRectifyMap(
                K, distortion, None, view, FRAME_SIZE, cv2.CV_16SC2
            ),
        ],
        REPETITIONS,
    )
    size = f"colour picture of {FRAME_SIZE[0]} x {FRAME_SIZE[1]}"
    return [
        Row(
            f"{size}: time of `Undistorter.undistort` / time of `cv2.undistort`",
            f"{1e3 * ours:.1f} ms / {1e3 * theirs:.1f} ms = {ours / theirs:.2f}",
            "1",
            ours <= theirs,
        ),
        Row(
            f"{size}: time of `Undistorter` / time of `cv2.initUndistortRectifyMap`",
            f"{1e3 * our_maps:.0f} ms / {1e3 * their_maps:.0f} ms",
            "",
            None,
        ),
    ]


def _point_time() -> list[Row]:
    """Compare the times of points with OpenCV's few iterations and with sufficiently many."""
    camera = _usual_camera(FRAME_SIZE)
    points = np.random.default_rng(SEED + 3).uniform(0, np.array(FRAME_SIZE) - 1, (POINTS, 2))
    K, distortion = camera.K.copy(), camera.distortion.copy()
    column = points.reshape(-1, 1, 2)

    def iterated() -> Array:
        return np.asarray(ITERATE(column, K, distortion, R=np.eye(3), P=K, criteria=EXACT))

    ours, theirs, exact = alternated_medians(
        [
            lambda: camera.undistort_points(points),
            lambda: cv2.undistortPoints(column, K, distortion, P=K),
            iterated,
        ],
        REPETITIONS,
    )
    undistorted = (cv2.undistortPoints(column, K, distortion, P=K), iterated())
    errors = [
        float(np.abs(camera.distort_points(own.reshape(-1, 2)) - points).max())
        for own in undistorted
    ]
    nanoseconds = 1e9 / POINTS
    return [
        Row(
            "a point: time of `undistort_points` / time of `cv2.undistortPoints`",
            f"{nanoseconds * ours:.0f} ns / {nanoseconds * theirs:.0f} ns "
            f"(OpenCV's error: {errors[0]:.1e} px)",
            "",
            None,
        ),
        Row(
            "a point: time of `undistort_points` / time of `cv2.undistortPoints` to convergence",
            f"{nanoseconds * ours:.0f} ns / {nanoseconds * exact:.0f} ns "
            f"(OpenCV's error: {errors[1]:.1e} px)",
            "1",
            ours <= exact,
        ),
    ]


def _usual_camera(size: tuple[int, int]) -> ts.Camera:
    """Return a wide lens as used for videos."""
    f = 0.7 * size[0]
    K = np.array([[f, 0.0, 0.51 * size[0]], [0.0, f, 0.49 * size[1]], [0.0, 0.0, 1.0]])
    return ts.Camera(K, [-0.28, 0.08, 0.001, -0.0005, -0.01], size, "brown")
