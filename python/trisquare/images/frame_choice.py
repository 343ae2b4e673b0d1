"""Choice of the frames of a video for calibration: sharp ones, each different from the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import whole_number
from trisquare.images.limits import PictureLimits
from trisquare.images.pixels import Image, ImageSource, VideoFrame, picture_size
from trisquare.images.reading import read_photograph
from trisquare.images.sources import VIDEO_SUFFIXES
from trisquare.images.video import Video, is_video

JUDGED_SIDE = 960
"""Longer side in pixels at which sharpness is judged: a frame that is blurred there gives poor
measurements, and a large frame takes no longer than a small one."""

THUMBNAIL = (32, 24)
"""Width and height of the pictures that are compared: views that differ by less are the same."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A frame with the criteria of its choice.

    Attributes
    ----------
    frame : VideoFrame
    sharpness : float
        Variance of the Laplacian over the variance of the grey levels: without unit, and
        independent of contrast.
    thumbnail : ndarray of float32, shape (24, 32)
        Grey levels relative to their mean, which changes with the exposure.
    distances : dict of int to float
        Mean absolute differences of the thumbnails from those of the other candidates, by frame
        number, grey levels.
    """

    frame: VideoFrame
    sharpness: float
    thumbnail: npt.NDArray[np.float32]
    distances: dict[int, float]

    @property
    def worth(self) -> float:
        """Higher for a sharp frame that is far from all others, zero for a duplicate.

        Of two that are nearest to each other, the less sharp one has the lower worth.
        """
        return self.sharpness * min(self.distances.values(), default=np.inf)


def with_frames(
    sources: Iterable[ImageSource],
    count: int | None,
    limits: PictureLimits | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[ImageSource]:
    """Return the pictures with each video replaced by that many of its frames.

    Parameters
    ----------
    sources : iterable of ImageSource
    count : int or None
        Frames of each video, or None to leave videos as they are.
    limits : PictureLimits, optional
    progress : callable, optional
        Called with the number of frames read, and the number that the video states.

    Raises
    ------
    ImageError
        If a video cannot be read completely.
    TypeError, ValueError
        If `count` is not a positive whole number, or none of the pictures is a video.
    """
    sources = list(sources)
    if count is None:
        return sources
    if whole_number(count, "frames") < 1:
        raise ValueError(f"frames must be at least 1, not {count}")
    chosen: list[ImageSource] = []
    has_video = False
    for source in sources:
        if isinstance(source, str | os.PathLike) and is_video(source):
            has_video = True
            chosen += choose_frames(source, count, limits, progress)
        else:
            check_named_video(source, limits)
            chosen.append(source)
    if not has_video:
        raise ValueError("frames are chosen from videos, but no video is given")
    return chosen


def check_named_video(source: ImageSource, limits: PictureLimits | None = None) -> None:
    """Refuse a file that has a video's name, but is neither a video nor a picture.

    Raises
    ------
    ImageError
        If it can be read as neither.
    """
    if not isinstance(source, str | os.PathLike):
        return
    if Path(source).suffix.lower() in VIDEO_SUFFIXES and not is_video(source):
        read_photograph(source, limits)


def choose_frames(
    path: str | os.PathLike[str],
    count: int,
    limits: PictureLimits | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[VideoFrame]:
    """Choose sharp and different frames of a video, in their order.

    The video is read once. At most `count` frames are kept: each new one replaces the one of
    least worth.

    Raises
    ------
    ImageError
        If the video cannot be read completely, or has too many frames.
    """
    kept: dict[int, _Candidate] = {}

    def drop_worst() -> None:
        worst = min(kept, key=lambda number: (kept[number].worth, -number))
        del kept[worst]
        for candidate in kept.values():
            del candidate.distances[worst]

    limits = PictureLimits.stated() if limits is None else limits
    with Video(path, limits) as video:
        limits.check_frames(video.name, video.stated_frames)
        for number, pixels in enumerate(video.frames()):
            limits.check_frames(video.name, number + 1)
            new = _judged(VideoFrame(video.name, number, pixels, video.turn))
            for earlier, other in kept.items():
                distance = float(np.abs(new.thumbnail - other.thumbnail).mean())
                new.distances[earlier] = other.distances[number] = distance
            kept[number] = new
            if len(kept) > count:
                drop_worst()
            if progress is not None:
                progress(number + 1, video.frames_in_all(number + 1))
    while len(kept) > 1 and min(candidate.worth for candidate in kept.values()) == 0:
        drop_worst()
    return [candidate.frame for candidate in kept.values()]


def _judged(frame: VideoFrame) -> _Candidate:
    import cv2  # loaded where a video is read

    grey: Image = cv2.cvtColor(frame.pixels, cv2.COLOR_BGR2GRAY)
    size = picture_size(grey)
    scale = JUDGED_SIDE / max(size)
    if scale < 1:
        judged_size = tuple(max(1, round(scale * side)) for side in size)
        grey = cv2.resize(grey, judged_size, interpolation=cv2.INTER_AREA)
    spread, edges = (
        float(cv2.meanStdDev(picture)[1][0, 0])
        for picture in (grey, cv2.Laplacian(grey, cv2.CV_16S))
    )
    thumbnail = cv2.resize(grey, THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float32)
    sharpness = (edges / spread) ** 2 if spread else 0.0
    return _Candidate(frame, sharpness, thumbnail - thumbnail.mean(), {})
