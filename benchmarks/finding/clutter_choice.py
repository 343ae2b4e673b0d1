"""Squares among rectangles: choice of the squares.

Right: answered and not wrong. Wrong: fx is off by more than 4 std and 1 %; silently: without a
warning that the chosen planes may be false.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import cv2
import numpy as np
from harness.choosing import choose
from harness.rows import Row

import trisquare as ts
from trisquare.measurement.detect import detect
from trisquare_scenes.distractors import MixedScene, mixed_scene, photograph

SEED = 31
RECTANGLES = 10
CASES = {0: 20, 1: 20, 2: 30, 3: 100, 4: 20, 6: 20}
"""Number of pictures by number of true squares."""

SIGMAS = 4.0
PART = 0.01
"""A focal length is wrong if its error exceeds both limits, in its own std and as a fraction."""

UNCERTAIN = ("choice", "contradict", "disagree", "rejected")
"""Words of warnings about planes that may be false. A warning about larger rejected objects, which
most of these pictures cause, is not counted."""

RIGHT_TARGET = 0.95


@dataclass(frozen=True, slots=True)
class Case:
    """Outcome of one picture.

    Attributes
    ----------
    found, false_found : int
        Number of true squares and of rectangles that the search found.
    kept, false_kept : int
        Number of those that the calibration used.
    error : float
        Error of fx, as a fraction; NaN where the calibration was refused.
    sigmas : float
        The same error in stated standard deviations.
    warned, any_warning : bool
        Whether a warning doubts the planes, and whether there is any warning.
    """

    found: int
    false_found: int
    kept: int
    false_kept: int
    error: float
    sigmas: float
    warned: bool
    any_warning: bool
    refusal: str
    seconds: float

    @property
    def refused(self) -> bool:
        """Return whether there was an error instead of an answer."""
        return bool(self.refusal)

    @property
    def wrong(self) -> bool:
        """Return whether there was a wrong answer."""
        return not self.refused and self.sigmas > SIGMAS and self.error > PART


def run_case(squares: int, index: int, seed: int = SEED) -> Case:
    """Draw, photograph and calibrate one scene."""
    rng = np.random.default_rng([seed, squares, index])
    mixed = mixed_scene(rng, squares=squares, rectangles=RECTANGLES)
    picture = photograph(mixed, rng)
    try:
        edges = detect(picture)
    except ts.DetectionError as error:
        return Case(0, 0, 0, 0, np.nan, np.nan, False, False, str(error), 0.0)
    found = [_target(mixed, np.mean(np.concatenate(one.points), axis=0)) for one in edges]
    start = time.perf_counter()
    choose(edges, mixed.scene.camera.image_size)
    seconds = time.perf_counter() - start
    true, false = _count(mixed, found)
    try:
        result = ts.calibrate(picture)
    except ts.TrisquareError as refusal:
        text = f"{type(refusal).__name__}: {refusal}"
        return Case(true, false, 0, 0, np.nan, np.nan, False, False, text, seconds)
    kept = [_target(mixed, plane.corners.mean(axis=0)) for plane in result.planes]
    error = abs(result.camera.K[0, 0] - mixed.scene.camera.fx)
    return Case(
        true,
        false,
        *_count(mixed, kept),
        error / mixed.scene.camera.fx,
        error / result.std["fx"],
        any(word in text for text in result.warnings for word in UNCERTAIN),
        bool(result.warnings),
        "",
        seconds,
    )


def _target(mixed: MixedScene, middle: np.typing.NDArray[np.float64]) -> int:
    """Return the index of the target at a position."""
    middles = [
        mixed.scene.image_points(i, np.zeros((1, 2)))[0] for i in range(len(mixed.is_square))
    ]
    return int(np.linalg.norm(np.array(middles) - middle, axis=1).argmin())


def _count(mixed: MixedScene, targets: list[int]) -> tuple[int, int]:
    """Return how many of the targets, each counted once, are squares, and how many are not."""
    squares = sum(mixed.is_square[i] for i in set(targets))
    return squares, len(set(targets)) - squares


def measure() -> list[Row]:
    """Print the outcomes of the pictures by number of true squares."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return [row for squares, count in CASES.items() for row in _rows(squares, count)]
    finally:
        cv2.setNumThreads(threads)


def _rows(squares: int, count: int) -> list[Row]:
    cases = [run_case(squares, index) for index in range(count)]
    for index, case in enumerate(cases):
        if case.wrong or (squares > 2 and case.refused):
            print(f"    {squares} squares, picture {index}: {case}")
    right = sum(not case.refused and not case.wrong for case in cases)
    exactly = sum(case.kept == squares and case.false_kept == 0 for case in cases)
    wrong = sum(case.wrong for case in cases)
    silent = sum(case.wrong and not case.warned for case in cases)
    unwarned = sum(case.wrong and not case.any_warning for case in cases)
    refused = sum(case.refused for case in cases)
    warned = sum(case.warned for case in cases)
    found = np.mean([case.found for case in cases])
    false_found = np.mean([case.false_found for case in cases])
    milliseconds = 1e3 * np.array([case.seconds for case in cases])
    print(
        f"  {squares} squares, {RECTANGLES} rectangles, {count} pictures: {found:.2f} and "
        f"{false_found:.1f} found; right {right} (exactly the squares {exactly}), warned "
        f"{warned}, refused {refused}, wrong {wrong}, silently wrong {silent}, without "
        f"any warning {unwarned}; choice {np.median(milliseconds):.0f} ms, at most "
        f"{milliseconds.max():.0f} ms",
        flush=True,
    )
    name = f"{squares} squares, {RECTANGLES} rectangles, {count} pictures"
    never = Row(f"{name}: silently wrong", str(silent), "0", silent == 0)
    if squares < 3:
        return [never]
    share = right / count
    target = RIGHT_TARGET if squares == 3 else None
    return [
        Row(
            f"{name}: right",
            f"{right}",
            f">= {target * count:.0f}" if target else "",
            share >= target if target else None,
        ),
        never,
    ]
