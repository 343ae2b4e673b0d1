"""Videos that tests write."""

import os
import struct

import cv2
import numpy as np

# Read when the first video is opened, in this process before the command can set it.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

ENCODERS = {".avi": "MJPG", ".mp4": "mp4v", ".flv": "\2\0\0\0"}

QUARTER_TURN = (0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30)
"""Matrix of ISO 14496-12, section 8.3.2, that turns what is shown clockwise by 90 degrees."""


def write_frames(path, frames, rate=10.0):
    """Write grey or BGR frames by OpenCV alone."""
    height, width = frames[0].shape[:2]
    encoder = cv2.VideoWriter.fourcc(*ENCODERS[path.suffix])
    writer = cv2.VideoWriter(str(path), encoder, rate, (width, height))
    for frame in frames:
        writer.write(frame if frame.ndim == 3 else cv2.merge([frame] * 3))
    writer.release()


def read_frames(path):
    """Read all frames by OpenCV alone, turned as players do."""
    capture, frames = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        frames.append(frame[1])
    return frames


def moving(count, size=(160, 120), step=4):
    """A smooth pattern that moves to the left: each frame differs from the others."""
    width, height = size
    noise = np.random.default_rng(3).integers(0, 256, (height, width + step * count, 3), np.uint8)
    pattern = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    return [np.ascontiguousarray(pattern[:, step * i : step * i + width]) for i in range(count)]


def turned_clockwise(encoded):
    """The content of an MP4 file that says that it is shown so."""
    at = encoded.index(b"tkhd") + 4 + 40
    matrix = struct.pack(">9i", *QUARTER_TURN)
    return encoded[:at] + matrix + encoded[at + len(matrix) :]


def stamped(encoded, milliseconds):
    """The content of an FLV file whose frames are shown at these times."""
    content, at, times = bytearray(encoded), 13, iter(milliseconds)
    while at + 11 < len(content):
        if content[at] == 9:  # a tag of video; its size, its time
            content[at + 4 : at + 7] = next(times).to_bytes(3, "big")
        at += 15 + int.from_bytes(content[at + 1 : at + 4], "big")
    return bytes(content)
