"""A picture of 24 megapixels: time relative to OpenCV's Canny detector, and peak memory.

The time is that of one thread, the larger of those in colour and in grey. The memory is that above
the decoded picture, the largest of five file formats.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image

SEED = 24
IMAGE_SIZE = (6000, 4000)
REDUCED = 2
REPETITIONS = 3
TIME_TARGET = 6.0  # times cv2.Canny
MEMORY_TARGET = 8.0  # bytes per pixel above the picture itself
KIBIBYTE = 1024.0

# Prints by how many KiB a calibration from a file raises the peak memory of a process that has
# already loaded everything loaded on first use. Writing 5 resets the peak to the resident memory.
CHILD = """
import sys
import cv2, numpy as np
import trisquare as ts

def peak():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))

small = np.zeros((480, 640), np.uint8)
for corner in ((40, 40), (400, 60), (220, 300)):
    cv2.rectangle(small, corner, (corner[0] + 120, corner[1] + 110), 255, -1)
try:
    ts.calibrate(small)
except ts.TrisquareError:
    pass
with open("/proc/self/clear_refs", "w") as reset:
    reset.write("5")
before = peak()
ts.calibrate(sys.argv[1])
print(peak() - before)
"""


def measure() -> list[Row]:
    """Print time ratios for pictures in memory, and peak memory for files."""
    colour = _large_photo()
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        ratios = {"colour": _ratio(colour), "grey": _ratio(grey)}
    finally:
        cv2.setNumThreads(threads)
    files = {
        "colour JPEG": (".jpg", colour),
        "colour PNG": (".png", colour),
        "grey PNG": (".png", grey),
        "16-bit grey PNG": (".png", grey.astype(np.uint16) * 257),
        "float TIFF": (".tif", (grey / np.float32(255)).astype(np.float32)),
    }
    bytes_per_pixel = {name: _memory(*file) for name, file in files.items()}
    worst_time, worst_memory = max(ratios.values()), max(bytes_per_pixel.values())
    return [
        Row(
            "from memory: time / time of `cv2.Canny`",
            f"{worst_time:.1f}",
            f"<= {TIME_TARGET:.0f}",
            worst_time <= TIME_TARGET,
        ),
        Row(
            "from a file: peak memory, bytes per pixel",
            f"{worst_memory:.1f} (colour JPEG {bytes_per_pixel['colour JPEG']:.1f})",
            f"<= {MEMORY_TARGET:.0f}",
            worst_memory <= MEMORY_TARGET,
        ),
    ]


def _large_photo() -> Image:
    """Render a photo-like picture at half the size, which is faster, and enlarge it.

    Its edges are then as soft as those of large photographs usually are: blurred by 1 to 2 px.
    """
    size = (IMAGE_SIZE[0] // REDUCED, IMAGE_SIZE[1] // REDUCED)
    rng = np.random.default_rng(SEED)
    small, _, _ = simulate.photo_like(rng, image_size=size)
    large = cv2.resize(small, IMAGE_SIZE, interpolation=cv2.INTER_CUBIC)
    grain = np.empty(large.shape, np.int8)
    cv2.setRNGSeed(SEED)
    cv2.randn(grain, np.zeros(3), np.full(3, 3.0))
    return cv2.add(large, grain, dtype=cv2.CV_8U)


def _ratio(picture: Image) -> float:
    whole, canny = alternated_medians(
        [lambda: ts.calibrate(picture), lambda: cv2.Canny(picture, 50, 150)], REPETITIONS
    )
    print(f"  {picture.ndim} axes: {whole:.2f} s, {whole / canny:.1f} Canny")
    return whole / canny


def _memory(extension: str, picture: Image) -> float:
    """Return the peak of a calibration from a file, bytes per pixel above the decoded picture."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"photo{extension}"
        cv2.imwrite(str(path), picture)
        command = [sys.executable, "-c", CHILD, str(path)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        printed = subprocess.run(
            command, check=True, capture_output=True, text=True, env=environment
        ).stdout
        encoded = path.stat().st_size
    pixels = IMAGE_SIZE[0] * IMAGE_SIZE[1]
    above = (float(printed) * KIBIBYTE - picture.nbytes) / pixels
    print(
        f"  {picture.dtype} {extension}, {picture.nbytes / pixels:.0f} bytes per pixel, "
        f"{encoded / pixels:.1f} in the file: {above:.1f} above"
    )
    return above
