"""Videos written by tests."""

import os
import struct

import cv2
import numpy as np

# Read when the first video is opened, in this process before the command can set it.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

ENCODERS = {".avi": "MJPG", ".mp4": "mp4v", ".flv": "\2\0\0\0"}

QUARTER_TURN = (0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30)
"""Matrix of ISO 14496-12, section 8.3.2, for a clockwise turn by 90 degrees when shown."""


def write_frames(path, frames, rate=10.0):
    """Write grey or BGR frames with OpenCV alone."""
    height, width = frames[0].shape[:2]
    encoder = cv2.VideoWriter.fourcc(*ENCODERS[path.suffix])
    writer = cv2.VideoWriter(str(path), encoder, rate, (width, height))
    for frame in frames:
        writer.write(frame if frame.ndim == 3 else cv2.merge([frame] * 3))
    writer.release()


def read_frames(path):
    """Read all frames with OpenCV alone, turned as by players."""
    capture, frames = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        frames.append(frame[1])
    return frames


def moving(count, size=(160, 120), step=4):
    """A smooth pattern that moves to the left, so that all frames differ."""
    width, height = size
    noise = np.random.default_rng(3).integers(0, 256, (height, width + step * count, 3), np.uint8)
    pattern = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    return [np.ascontiguousarray(pattern[:, step * i : step * i + width]) for i in range(count)]


def turned_clockwise(encoded):
    """The content of an MP4 file that states such a turn."""
    at = encoded.index(b"tkhd") + 4 + 40
    matrix = struct.pack(">9i", *QUARTER_TURN)
    return encoded[:at] + matrix + encoded[at + len(matrix) :]


def _video_tags(encoded):
    """Yield the start and end of the tags of an FLV file's frames."""
    at = 13
    while at + 11 < len(encoded):
        end = at + 15 + int.from_bytes(encoded[at + 1 : at + 4], "big")
        if encoded[at] == 9:
            yield at, end
        at = end


def stamped(encoded, milliseconds):
    """The content of an FLV file with given times of its frames."""
    content = bytearray(encoded)
    for (at, _), time in zip(_video_tags(encoded), milliseconds, strict=True):
        content[at + 4 : at + 7] = time.to_bytes(3, "big")
    return bytes(content)


def with_larger_frames(encoded, size, count):
    """The content of an FLV file with `count` more frames, each with a size of its own."""
    _, (at, end), *_ = _video_tags(encoded)
    codec, picture = encoded[at + 11], encoded[at + 12 : end - 4]
    bits = "".join(f"{byte:08b}" for byte in picture)
    assert bits[30:33] == "000"  # 8 bits per side; 001 is 16 bits
    bits = bits[:30] + "001" + "".join(f"{side:016b}" for side in size) + bits[49:]
    bits += "0" * (-len(bits) % 8)
    payload = bytes([codec, *(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8))])
    tag = encoded[at : at + 1] + len(payload).to_bytes(3, "big") + encoded[at + 4 : at + 11]
    tag += payload + (11 + len(payload)).to_bytes(4, "big")
    return encoded[:at] + tag * count + encoded[at:]
