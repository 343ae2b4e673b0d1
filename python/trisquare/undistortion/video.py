"""Videos without their lens's distortion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing

from trisquare._support.threads import ahead
from trisquare._support.writing import PathLike
from trisquare.images.pixels import Image
from trisquare.images.video import Video, write_video
from trisquare.undistortion.undistort import Interpolation, Undistorter

FRAMES_AHEAD = 3
"""Number of frames buffered per thread, which evens out frames that take longer to decode or to
encode."""


def undistort_video(
    video: Video,
    undistorter: Undistorter,
    path: PathLike,
    *,
    interpolation: Interpolation = "linear",
    progress: Callable[[int], None] | None = None,
) -> int:
    """Undistort a video, write it, and return its number of frames.

    Decoding, undistorting and encoding run in parallel, in a thread each. The frames are turned as
    players turn those of `video`; sound is left out.

    Parameters
    ----------
    video : Video
        A video of the size of the undistorter's camera. It is read to its end.
    undistorter : Undistorter
    path : str or path
        See `write_video`.
    interpolation : str
        See `Undistorter.undistort`.
    progress : callable, optional
        Called with the number of undistorted frames.

    Raises
    ------
    ImageError
        If the video has no frames or ends too early.
    ValueError
        If its frames are of another size, or for a bad argument.
    OSError
        If the file cannot be written completely.
    """

    def undistorted(frames: Iterator[Image]) -> Iterator[Image]:
        for done, frame in enumerate(frames, 1):
            yield undistorter.undistort(frame, interpolation=interpolation)
            if progress is not None:
                progress(done)

    with (
        closing(ahead(video.frames(), FRAMES_AHEAD)) as frames,
        closing(ahead(undistorted(frames), FRAMES_AHEAD)) as straight,
    ):
        return write_video(path, straight, video.rate, video.turn)
