"""One picture of three squares beside OpenCV's Zhang on 13 pictures of a chessboard."""

from __future__ import annotations

import cv2
import numpy as np
from rows import Row
from truth import PINHOLE, Array, camera_vector, errors, rms, rms_per_parameter

import trisquare as ts
from trisquare import simulate
from trisquare.scene import Scene, TrueCamera

CAMERAS = 12
SESSIONS = 3  # of 13 chessboard pictures, per camera
SQUARES = 8  # pictures of three squares, per camera and kind
BOARDS = 13
SEED = 5
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
SOLID_TARGET = 1.05
FRAMED_TARGET = 0.85

# What a corner detector leaves for cornerSubPix to do, pixels.
DETECTED = 0.3
# Half window of cornerSubPix in cells. Of 3-11 px and 0.25-0.42 cells this makes the corners
# most exact: the widest window without another corner in it.
WINDOW = 0.42
SUBPIX_END = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
SAME_MODEL = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


def measure() -> list[Row]:
    """Print the rms errors over fx, fy, cx, cy and the ratios to Zhang's."""
    collected: dict[str, list[Array]] = {"zhang": [], "square": [], "frame": []}
    for number in range(CAMERAS):
        rng = np.random.default_rng([SEED, number])
        camera = simulate.random_camera(rng)
        photo = {"noise": rng.uniform(*NOISE_RANGE), "blur": rng.uniform(*BLUR_RANGE)}
        collected["zhang"] += [_zhang(camera, rng, photo) for _ in range(SESSIONS)]
        for kind in ("square", "frame"):
            for _ in range(SQUARES):
                scene = simulate.random_scene(rng, camera=camera, kind=kind)
                picture = simulate.render(scene, rng, tone="linear", **photo)
                result = ts.calibrate(picture, tone="linear")
                collected[kind].append(errors(result, camera))
    pinhole = {}
    for kind, found in collected.items():
        table = np.array(found)
        pinhole[kind] = table[:, : len(PINHOLE)]
        print(
            f"  {kind}: {rms_per_parameter(table)}; median {np.median(np.abs(pinhole[kind])):.3f}"
        )
    print(f"  stage {result.stage}")
    return [
        _row("solid", pinhole["square"], pinhole["zhang"], SOLID_TARGET),
        _row("framed", pinhole["frame"], pinhole["zhang"], FRAMED_TARGET),
    ]


def _row(kind: str, squares: Array, zhang: Array, target: float) -> Row:
    ratio = rms(squares) / rms(zhang)
    return Row(
        f"one picture of three squares / Zhang on {BOARDS} chessboards, {kind}, {CAMERAS} cameras",
        f"{ratio:.2f} ({rms(squares):.3f} px / {rms(zhang):.3f} px)",
        f"<= {target}",
        ratio <= target,
    )


def _zhang(camera: TrueCamera, rng: np.random.Generator, photo: dict[str, float]) -> Array:
    """Return the error of one chessboard session, shape (6,)."""
    scenes = [simulate.chessboard_scene(rng, camera) for _ in range(BOARDS)]
    board = scenes[0].targets[0].board_corners()
    objects = np.column_stack([board, np.zeros(len(board))]).astype(np.float32)
    corners = [_corners(scene, rng, photo) for scene in scenes]
    _, K, distortion, _, _ = cv2.calibrateCamera(
        [objects] * BOARDS, corners, camera.image_size, None, None, flags=SAME_MODEL
    )
    return camera_vector(K, distortion.ravel()) - camera_vector(camera.K, camera.distortion)


def _corners(scene: Scene, rng: np.random.Generator, photo: dict[str, float]) -> Array:
    """Photograph a board and measure its corners as OpenCV does, shape (N, 1, 2)."""
    picture = simulate.render(scene, rng, tone="linear", **photo)
    target = scene.targets[0]
    columns, rows = target.inner_corners
    truth = scene.image_points(0, target.board_corners())
    grid = truth.reshape(rows, columns, 2)
    cell = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    half = int(WINDOW * cell)
    detected = truth + DETECTED * rng.standard_normal(truth.shape)
    points = detected.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(picture, points, (half, half), (-1, -1), SUBPIX_END)
