"""Time from a picture in memory to the result, relative to OpenCV's Canny detector.

Pictures of 1280 x 960 pixels, one thread; both times are of the same picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image

PICTURES = 5
REPETITIONS = 15
SEED = 6
TARGET, GOAL = 9.0, 5.0
PHOTO_TARGET = 2.5
CLUTTER_TARGET = 9.0

DEMO = Path(ts.__file__).parent / "data" / "demo.png"


def measure() -> list[Row]:
    """Print the ratio for plain grey pictures of squares, photo-like ones, and one with clutter."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        ratio, seconds = _ratio("plain", _drawn(_plain))
        photo_ratio, photo_seconds = _ratio("photo", _drawn(_photo))
        clutter_ratio, clutter_seconds = _ratio("clutter", [ts.read_image(DEMO)])
    finally:
        cv2.setNumThreads(threads)
    print(f"  plain grey {1e3 * seconds:.1f} ms, {ratio:.1f} Canny")
    print(f"  photo-like colour {1e3 * photo_seconds:.1f} ms, {photo_ratio:.1f} Canny")
    print(f"  with clutter {1e3 * clutter_seconds:.1f} ms, {clutter_ratio:.1f} Canny")
    return [
        Row(
            "squares, grey: time / time of `cv2.Canny`",
            f"{ratio:.1f} ({1e3 * seconds:.1f} ms)",
            f"<= {TARGET:.0f}, goal {GOAL:.0f}",
            ratio <= TARGET,
        ),
        Row(
            "pictures like photographs, colour: time / time of `cv2.Canny`",
            f"{photo_ratio:.1f} ({1e3 * photo_seconds:.1f} ms)",
            f"<= {PHOTO_TARGET}",
            photo_ratio <= PHOTO_TARGET,
        ),
        Row(
            "picture of `trisquare demo`, frames with clutter, grey: time / time of `cv2.Canny`",
            f"{clutter_ratio:.1f} ({1e3 * clutter_seconds:.1f} ms)",
            f"<= {CLUTTER_TARGET:.0f}",
            clutter_ratio <= CLUTTER_TARGET,
        ),
    ]


def _drawn(draw: Callable[[np.random.Generator], Image]) -> list[Image]:
    return [draw(np.random.default_rng([SEED, seed])) for seed in range(PICTURES)]


def _ratio(name: str, pictures: Sequence[Image]) -> tuple[float, float]:
    """Return the median ratio over the pictures, and the median seconds to a result."""
    ratios, seconds = [], []
    for picture in pictures:
        whole, canny = alternated_medians(
            [
                lambda shot=picture: ts.calibrate(shot),
                lambda shot=picture: cv2.Canny(shot, 50, 150),
            ],
            REPETITIONS,
        )
        ratios.append(whole / canny)
        seconds.append(whole)
    print(f"  {name}: {', '.join(f'{ratio:.1f}' for ratio in ratios)}")
    return float(np.median(ratios)), float(np.median(seconds))


def _plain(rng: np.random.Generator) -> Image:
    noise, blur = rng.uniform(1.0, 4.0), rng.uniform(0.5, 1.2)
    return simulate.render(simulate.random_scene(rng), rng, noise=noise, blur=blur, tone="srgb")


def _photo(rng: np.random.Generator) -> Image:
    return simulate.photo_like(rng)[0]
