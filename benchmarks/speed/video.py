"""Undistorting a video, compared with OpenCV's reader, `remap` and writer.

Both compute their maps once and write with the same encoder; OpenCV's own threads are at their
default.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare.images.frame_choice import choose_frames
from trisquare.images.video import ENCODERS, Video
from trisquare.undistortion.video import undistort_video

SEED = 31
SIZE = (1920, 1080)
FRAMES = 120
RATE = 30.0
STEP = 3
"""Displacement of the scene from frame to frame, in pixels."""
REPETITIONS = 5
CHOSEN = 10
TARGET = 1.0

CAMERA = ts.Camera(
    [[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]],
    [-0.25, 0.05, 0.0, 0.0, 0.0],
    SIZE,
)


def measure() -> list[Row]:
    """Print the times per frame, alternated."""
    rows = []
    for suffix in (".mp4", ".avi"):
        with tempfile.TemporaryDirectory() as folder:
            clip = Path(folder, f"clip{suffix}")
            _write_clip(clip)
            rows.append(_undistorting(clip))
            if suffix == ".mp4":
                rows.append(_choosing(clip))
    return rows


def _write_clip(path: Path) -> None:
    width, height = SIZE
    noise = np.random.default_rng(SEED).integers(
        0, 256, (height, width + STEP * FRAMES, 3), np.uint8
    )
    scene = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 4), None, 0, 255, cv2.NORM_MINMAX)
    writer = _writer(path)
    for index in range(FRAMES):
        writer.write(np.ascontiguousarray(scene[:, STEP * index : STEP * index + width]))
    writer.release()


def _writer(path: Path) -> cv2.VideoWriter:
    return cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*ENCODERS[path.suffix]), RATE, SIZE)


def _undistorting(clip: Path) -> Row:
    out = clip.with_stem("out")

    def ours() -> None:
        with Video(clip) as video:
            undistort_video(video, ts.Undistorter(CAMERA), out)

    def theirs() -> None:
        K, view = CAMERA.K.copy(), CAMERA.undistorted().K.copy()
        distortion = CAMERA.distortion.copy()
        maps = cv2.initUndistortRectifyMap(K, distortion, None, view, SIZE, cv2.CV_16SC2)
        capture, writer = cv2.VideoCapture(str(clip)), _writer(out)
        while (frame := capture.read())[0]:
            writer.write(cv2.remap(frame[1], *maps, cv2.INTER_LINEAR))
        writer.release()

    ours_time, theirs_time = (
        1e3 * seconds / FRAMES for seconds in alternated_medians([ours, theirs], REPETITIONS)
    )
    ratio = ours_time / theirs_time
    return Row(
        f"{SIZE[0]} x {SIZE[1]} {clip.suffix}: time of a frame / time with OpenCV",
        f"{ours_time:.1f} ms / {theirs_time:.1f} ms = {ratio:.2f}",
        f"{TARGET:.0f}",
        ratio <= TARGET,
    )


def _choosing(clip: Path) -> Row:
    def decode() -> None:
        capture = cv2.VideoCapture(str(clip))
        while capture.read()[0]:
            pass

    ours, theirs = (
        1e3 * seconds / FRAMES
        for seconds in alternated_medians([lambda: choose_frames(clip, CHOSEN), decode], 3)
    )
    return Row(
        f"{SIZE[0]} x {SIZE[1]} {clip.suffix}: time of a frame, choosing {CHOSEN} / decoding all",
        f"{ours:.1f} ms / {theirs:.1f} ms",
        "",
        None,
    )
