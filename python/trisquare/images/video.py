"""Videos: their frames one after another, read and written by OpenCV; their sound by ffmpeg."""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from trisquare._support.paths import shown
from trisquare._support.writing import PathLike
from trisquare.errors import ImageError, MissingImageError, lacks_memory
from trisquare.images.foreign import TRANSPORT_PACKET, VIDEO, foreign_kind
from trisquare.images.limits import MAX_SECONDS_MORE, SLOWEST_PIXELS, PictureLimits
from trisquare.images.pixels import Image

ENCODERS = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
"""Encoders by the extension of the file's name, which every OpenCV with FFmpeg encodes at a video's
speed. Files of these formats cannot be opened, or state another number of frames, if their last
part is missing."""

FRAME_COUNT_ERROR = 0.02
LOST_FRAMES = 2
"""Maximum excess of the number of frames that a complete video states: a fraction of it, if it is
estimated from the duration, and frames at the ends that cannot be decoded alone."""

PROBED_BYTES = 1 << 16
"""Bytes that the disk must have left after a video: the last part that FFmpeg writes is not
longer."""

MAX_ALLOCATION = 128_000_000
"""Maximum allocation of FFmpeg in bytes: a frame of 42 megapixels, more than 8K video has. Without
this limit it allocates what a header states, up to 2 GB, before it checks whether that is there."""

TURNS = {90: "ROTATE_90_CLOCKWISE", 180: "ROTATE_180", 270: "ROTATE_90_COUNTERCLOCKWISE"}
"""OpenCV's name of the turn, by its degrees, by which a stored frame is shown upright."""


def is_video(path: PathLike) -> bool:
    """Return whether a file exists and begins as a video does."""
    try:
        if not os.path.isfile(path):
            return False  # a pipe would be read empty
        with open(path, "rb") as file:
            return foreign_kind(file.read(3 * TRANSPORT_PACKET), os.fspath(path)) == VIDEO
    except OSError:
        return False


def check_video_name(path: PathLike) -> None:
    """Raise ValueError if no format in which videos are written has the path's extension."""
    suffix = Path(path).suffix
    if suffix.lower() not in ENCODERS:
        name = shown(path)
        raise ValueError(
            f"{name}: videos are written as {', '.join(ENCODERS)}, not with the extension "
            f"{suffix!r}"
        )


class Video:
    """An open video, to be closed by ``with``.

    Attributes
    ----------
    name : str
        Name in messages.
    size : (int, int)
        Width and height of a frame as it is stored, in pixels.
    rate : float
        Frames per second.
    stated_frames : int
        Number of frames that it states; it may have a few less. Zero if it states none.
    turn : int
        Degrees by which players turn the stored frames clockwise: 0, 90, 180 or 270.
    unevenness : float
        Maximum difference in seconds between the time stamps of the frames read so far and those
        of an even rate.

    Raises
    ------
    ImageError
        If the file is missing (`MissingImageError`), not a video that OpenCV reads, or its frames
        have more pixels than the limits allow.
    """

    def __init__(self, path: PathLike, limits: PictureLimits | None = None) -> None:
        import cv2  # loaded where a video is read

        _limit_allocations()
        self.name = os.fspath(path)
        if not os.path.exists(path):
            raise MissingImageError(f"{self.name}: No such file or directory", path)
        # The whole path: FFmpeg may take a name alone for an address or a camera. It may do so with
        # the entries of a playlist, too, which is not a video.
        capture = cv2.VideoCapture(os.path.realpath(path)) if is_video(path) else None
        if capture is None or not capture.isOpened():
            raise ImageError(f"{self.name}: not a readable video, or one without frames")
        self._capture = capture
        # As the sensor delivered them, like photographs: one camera applies to both.
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        width, height, count, self.rate, turn = (
            self._capture.get(which)
            for which in (
                cv2.CAP_PROP_FRAME_WIDTH,
                cv2.CAP_PROP_FRAME_HEIGHT,
                cv2.CAP_PROP_FRAME_COUNT,
                cv2.CAP_PROP_FPS,
                cv2.CAP_PROP_ORIENTATION_META,
            )
        )
        self.size = int(width), int(height)
        self.stated_frames = max(0, int(count))
        self.turn = int(turn) if turn in TURNS else 0
        self.unevenness = 0.0
        (PictureLimits.stated() if limits is None else limits).check_pixels(self.name, self.size)
        if width * height * 3 > MAX_ALLOCATION:
            raise ImageError(
                f"{self.name}: has frames of {self.size[0]} x {self.size[1]} pixels, more than the "
                f"{MAX_ALLOCATION // 3_000_000} megapixels that frames of a video may have"
            )

    def frames_in_all(self, done: int) -> int:
        """Return the number of all frames, once `done` are read: the video may state too few."""
        return max(done, self.stated_frames)

    def frames(self) -> Iterator[Image]:
        """Yield the frames, once: uint8, shape (H, W, 3), BGR, rows and columns as stored.

        Raises
        ------
        ImageError
            If the reader fails on a damaged frame, or decoding takes as long as that of far larger
            ones; at the end, if there were none, or markedly fewer than the video states.
        """
        import cv2  # loaded where a video is read

        frame_count, seconds, start = 0, 0.0, 0.0
        width, height = self.size
        while True:
            if seconds > MAX_SECONDS_MORE + frame_count * width * height / SLOWEST_PIXELS:
                raise ImageError(
                    f"{self.name}: damaged or hostile: decoding {frame_count} frames of {width} x "
                    f"{height} pixels took {seconds:.1f} s, as if they were far larger"
                )
            clocks_before = _clocks()
            try:
                has_frame, frame = self._capture.read()
            except cv2.error as error:  # of OpenCV's own reader, used where FFmpeg fails
                if lacks_memory(error):
                    raise
                raise ImageError(f"{self.name}: damaged after {frame_count} frames") from error
            # The smaller one: other threads add to processor time, other programs to elapsed time.
            seconds += min(
                after - before for after, before in zip(_clocks(), clocks_before, strict=True)
            )
            if not has_frame:
                break
            stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            start = start if frame_count else stamp
            if self.rate > 0 and stamp > start:  # it does not change without time stamps
                self.unevenness = max(self.unevenness, abs(stamp - start - frame_count / self.rate))
            frame_count += 1
            yield frame
        if not frame_count:
            raise ImageError(f"{self.name}: a video without frames")
        if frame_count < (1 - FRAME_COUNT_ERROR) * self.stated_frames - LOST_FRAMES:
            raise ImageError(
                f"{self.name}: truncated: {frame_count} of {self.stated_frames} frames can be read"
            )

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *error: object) -> None:
        self._capture.release()


@functools.cache
def _limit_allocations() -> None:
    """Limit each allocation of the FFmpeg in OpenCV's wheel for Linux, permanently."""
    import cv2  # loaded where a video is read

    for library in Path(cv2.__file__).parents[1].glob("opencv_*.libs/libavutil*.so*"):
        ctypes.CDLL(os.fspath(library)).av_max_alloc(ctypes.c_size_t(MAX_ALLOCATION))


def _clocks() -> tuple[float, float]:
    """Return the processor time of this process, and the elapsed time, in seconds."""
    return time.process_time(), time.perf_counter()


def write_video(path: PathLike, frames: Iterable[Image], rate: float, turn: int = 0) -> int:
    """Write frames as a video without sound, and return how many there were.

    Parameters
    ----------
    path : str or path
        Its extension states the format, see `check_video_name`.
    frames : iterable of ndarray of uint8, shape (H, W, 3)
        BGR, all of one size. An odd last column or row is left out: most video consists of pairs
        of pixels.
    rate : float
        Frames per second.
    turn : {0, 90, 180, 270}
        Degrees by which they are turned clockwise before they are written.

    Raises
    ------
    ValueError
        If the extension names no format, the rate is not positive, or there are no frames.
    OSError
        If the file cannot be written completely.
    """
    import cv2  # loaded where a video is written

    check_video_name(path)
    if not 0 < rate < float("inf"):
        raise ValueError(f"a video has a positive number of frames per second, not {rate}")
    encoder = cv2.VideoWriter.fourcc(*ENCODERS[Path(path).suffix.lower()])
    writer, written = None, 0
    try:
        for frame in frames:
            turned = cv2.rotate(frame, getattr(cv2, TURNS[turn])) if turn else frame
            if writer is None:
                height, width = (size // 2 * 2 for size in turned.shape[:2])
                writer = cv2.VideoWriter(os.fspath(path), encoder, rate, (width, height))
                if not writer.isOpened():
                    raise OSError(errno.EINVAL, "this OpenCV does not encode such a video")
            writer.write(turned[:height, :width])
            written += 1
    finally:
        if writer is not None:
            writer.release()
    if not written:
        raise ValueError("a video has at least one frame")
    # OpenCV does not report whether the file is complete on the disk. A full disk refuses more.
    with open(path, "r+b") as file:
        end = file.seek(0, os.SEEK_END)
        file.write(bytes(PROBED_BYTES))
        file.truncate(end)
    capture = cv2.VideoCapture(os.fspath(path))
    if not capture.isOpened() or capture.get(cv2.CAP_PROP_FRAME_COUNT) != written:
        raise OSError(
            errno.EIO, "the video was not completely written to the disk, which may be full"
        )
    return written


def add_sound(path: PathLike, source: PathLike) -> str | None:
    """Copy the sound of a video, as it is coded, into another that has none.

    Returns
    -------
    str or None
        Reason why it is not copied, if so; the video is then unchanged.
    """
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        return "its sound, if any, is left out: ffmpeg, which would copy it, is not on the PATH"
    silent_path = Path(path)
    path_with_sound = silent_path.with_name(f".sound{silent_path.name}")
    command = [ffmpeg, "-nostdin", "-v", "error", "-max_alloc", str(MAX_ALLOCATION), "-n"]
    command += ["-i", f"file:{path}", "-i", f"file:{os.path.realpath(source)}"]
    command += ["-map", "0:v", "-map", "1:a?", "-c", "copy", f"file:{path_with_sound}"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, errors="replace")
        if result.returncode == 0:
            path_with_sound.replace(silent_path)
            return None
        reason = result.stderr.strip().split("\n")[0]
        return f"its sound is left out: ffmpeg cannot copy it ({reason})"
    except OSError as error:
        return f"its sound is left out: ffmpeg cannot be run ({error.strerror})"
    finally:
        path_with_sound.unlink(missing_ok=True)
