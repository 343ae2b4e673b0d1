"""One picture of three squares compared with Zhang's method on 13 pictures of a chessboard.

The errors are those of fx, fy, cx and cy in pixels; Zhang's method is OpenCV's `calibrateCamera`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from harness.rows import Row
from harness.truth import PINHOLE, Array, camera_vector, errors, rms, rms_per_parameter

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image
from trisquare.simulate.scene import TrueCamera

CAMERAS = 12
SESSIONS = 3  # of 13 chessboard pictures, per camera
SQUARES = 8  # pictures of three squares, per camera and kind
BOARDS = 13
SEED = 5
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
SOLID_TARGET = 1.05
FRAMED_TARGET = 0.85

# Error of a corner detector before cornerSubPix, in pixels.
DETECTED = 0.3
# Half windows of cornerSubPix, in pixels. OpenCV's tutorial uses 11, as does the row.
WINDOWS = (5, 11, 17)
TUTORIAL_WINDOW = 11
SUBPIX_END = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
SAME_MODEL = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


def measure() -> list[Row]:
    """Print the rms errors over fx, fy, cx, cy and their ratios to those of Zhang's method."""
    collected: dict[str, list[Array]] = {"square": [], "frame": []}
    collected |= {_label(window): [] for window in WINDOWS}
    stages: Counter[str] = Counter()
    for number in range(CAMERAS):
        rng = np.random.default_rng([SEED, number])
        camera = simulate.random_camera(rng)
        photo = {"noise": rng.uniform(*NOISE_RANGE), "blur": rng.uniform(*BLUR_RANGE)}
        for _ in range(SESSIONS):
            boards = photograph_boards(camera, rng, photo)
            for window in WINDOWS:
                collected[_label(window)].append(_zhang(camera, boards, window))
        for kind in ("square", "frame"):
            for _ in range(SQUARES):
                scene = simulate.random_scene(rng, camera=camera, kind=kind)
                picture = simulate.render(scene, rng, tone="linear", **photo)
                result = ts.calibrate(picture, tone="linear")
                collected[kind].append(errors(result, camera))
                stages[result.stage] += 1
    pinhole = {}
    for kind, found in collected.items():
        table = np.array(found)
        pinhole[kind] = table[:, : len(PINHOLE)]
        print(
            f"  {kind}: {rms_per_parameter(table)}; median {np.median(np.abs(pinhole[kind])):.3f}"
        )
    print(f"  stages: {dict(stages)}")
    return [
        _row("solid squares", pinhole["square"], pinhole[_label(TUTORIAL_WINDOW)], SOLID_TARGET),
        _row("frames", pinhole["frame"], pinhole[_label(TUTORIAL_WINDOW)], FRAMED_TARGET),
    ]


def _row(kind: str, squares: Array, zhang: Array, target: float) -> Row:
    ratio = rms(squares) / rms(zhang)
    return Row(
        f"{kind}, {CAMERAS} cameras: rms error / rms error of Zhang's method",
        f"{ratio:.2f} ({rms(squares):.3f} px / {rms(zhang):.3f} px)",
        f"<= {target}",
        ratio <= target,
    )


def _label(window: int) -> str:
    return f"zhang, cornerSubPix ({window}, {window})"


@dataclass(frozen=True, slots=True)
class BoardPicture:
    """A photographed chessboard, with corners as a detector gives them."""

    picture: Image
    detected: npt.NDArray[np.float32]
    board: npt.NDArray[np.float32]


def photograph_boards(
    camera: TrueCamera, rng: np.random.Generator, photo: dict[str, float]
) -> list[BoardPicture]:
    """Photograph a chessboard in random poses."""
    pictures = []
    for _ in range(BOARDS):
        scene = simulate.chessboard_scene(rng, camera)
        picture = simulate.render(scene, rng, tone="linear", **photo)
        board = scene.targets[0].board_corners()
        corners = scene.image_points(0, board)
        detected = corners + DETECTED * rng.standard_normal(corners.shape)
        solid = np.column_stack([board, np.zeros(len(board))])
        pictures.append(
            BoardPicture(picture, detected.astype(np.float32)[:, None], solid.astype(np.float32))
        )
    return pictures


def _zhang(camera: TrueCamera, boards: list[BoardPicture], window: int) -> Array:
    """Return the error of one chessboard calibration, shape (6,)."""
    K, distortion = zhang_camera(camera, boards, window)
    return camera_vector(K, distortion) - camera_vector(camera.K, camera.distortion)


def zhang_camera(
    camera: TrueCamera, boards: list[BoardPicture], window: int
) -> tuple[Array, Array]:
    """Return camera matrix and distortion of one chessboard calibration, shapes (3, 3) and (5,)."""
    half = (window, window)
    corners = [
        cv2.cornerSubPix(shot.picture, shot.detected.copy(), half, (-1, -1), SUBPIX_END)
        for shot in boards
    ]
    objects = [shot.board for shot in boards]
    _, K, distortion, _, _ = cv2.calibrateCamera(
        objects, corners, camera.image_size, None, None, flags=SAME_MODEL
    )
    return K, distortion.ravel()
