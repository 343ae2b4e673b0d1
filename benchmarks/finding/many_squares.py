"""A thousand squares in one picture of 12 megapixels: time, and silently wrong results.

The squares are 12 to 20 px wide in the picture that is searched, and each has another tilt, so that
one square hardly determines the camera, and nearly any parallelogram could be a square. The choice
among the squares is also tested with edge points, where no search has removed false squares.
Silently wrong: fx is off by more than 4 std and 0.3 %, and there is no warning above low severity.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from harness.choosing import choose
from harness.rows import Row
from harness.stopwatch import alternated_medians

import trisquare as ts
from trisquare.edges import changed_edges
from trisquare.images.pixels import Image
from trisquare.simulate import edge_points, render
from trisquare_scenes.distractors import MixedScene
from trisquare_scenes.many_squares import many_squares

SEED = 14
SQUARES = 1000
FALSE = 200
PICTURES = 2
"""Number of pictures of each kind. Their median time counts; rendering takes most of the time."""

SCENES = 20
EDGE_SQUARES = 250
EDGE_FALSE = 50
"""Number of scenes with false squares, from edges. It is smaller, because the choice among a
thousand takes minutes where no search has removed the worst."""

NOISE = 0.06
"""Noise of edge points 4 px apart, in pixels: that of a picture with a noise of 2 grey levels."""

SIGMAS = 4.0
PART = 0.003
"""A focal length is wrong if its error exceeds both limits, in its own std and as a fraction."""

SECONDS_TARGET = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """Outcome of one scene."""

    seconds: float
    kept: int = 0
    error: float = np.nan
    sigmas: float = np.nan
    warnings: tuple[str, ...] = ()
    refusal: str = ""

    @classmethod
    def of(
        cls,
        many: MixedScene,
        seconds: float,
        kept: int,
        found: tuple[float, float],
        codes: set[str],
    ) -> Case:
        """Compare a focal length and its standard deviation with the truth."""
        (focal, std), true = found, many.scene.camera.fx
        error = abs(focal - true)
        return cls(seconds, kept, error / true, error / std, tuple(sorted(codes)))

    @property
    def wrong(self) -> bool:
        """Return whether there was a wrong answer."""
        return not self.refusal and self.sigmas > SIGMAS and self.error > PART

    @property
    def warned(self) -> bool:
        """Return whether there is a warning above low severity."""
        return bool(self.warnings)

    def __str__(self) -> str:
        """Return the outcome in a line."""
        codes = ", ".join(self.warnings)
        return (
            f"{self.seconds:.2f} s, {self.kept} kept, fx off by {100 * self.error:.3f} %, "
            f"{self.sigmas:.1f} std {codes} {self.refusal}"
        )


def drawn(count: int, false: int, index: int) -> tuple[MixedScene, np.random.Generator]:
    """Draw one scene; also return the generator for its noise."""
    rng = np.random.default_rng([SEED, false, index])
    return many_squares(rng, count, false=false), rng


def from_picture(many: MixedScene, picture: Image) -> Case:
    """Calibrate a picture and compare with the truth."""
    start = time.perf_counter()
    try:
        result = ts.calibrate(picture)
    except ts.TrisquareError as refusal:
        text = f"{type(refusal).__name__}: {refusal}"
        return Case(time.perf_counter() - start, refusal=text)
    seconds = time.perf_counter() - start
    codes = {warning.code for warning in result.warnings if warning.severity != "low"}
    found = (result.camera.K[0, 0], result.std["fx"])
    return Case.of(many, seconds, len(result.planes), found, codes)


def from_edges(many: MixedScene, rng: np.random.Generator) -> Case:
    """Choose among the edges of a scene as among those of a picture, and calibrate."""
    sides = edge_points(many.scene, rng, noise=NOISE)
    figures = [changed_edges(ts.PlaneEdges.square(own), plane=i) for i, own in enumerate(sides)]
    start = time.perf_counter()
    try:
        outcome = choose(figures, many.scene.camera.image_size)
        solution = outcome.solution()
    except ts.TrisquareError as refusal:
        text = f"{type(refusal).__name__}: {refusal}"
        return Case(time.perf_counter() - start, refusal=text)
    seconds = time.perf_counter() - start
    codes = {warning[1] for warning in solution.warnings if warning[2] != "low"}
    if outcome.doubt is not None:
        codes.add("choice_uncertain")
    found = (float(solution.camera_matrix[0, 0]), solution.std["fx"])
    return Case.of(many, seconds, len(solution.planes), found, codes)


def measure() -> list[Row]:
    """Print the outcomes of the scenes."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rows = [_time_row(0), _time_row(FALSE)]
    finally:
        cv2.setNumThreads(threads)
    return [*rows, _silent_row()]


def _time_row(false: int) -> Row:
    cases, multiples = [], []
    for index in range(PICTURES):
        many, rng = drawn(SQUARES, false, index)
        picture = render(many.scene, rng, noise=rng.uniform(1.0, 3.0), blur=rng.uniform(0.5, 1.0))
        case = from_picture(many, picture)
        (canny,) = alternated_medians([partial(cv2.Canny, picture, 50, 150)], 3)
        print(f"  picture, {false} false: {case}, {case.seconds / canny:.0f} Canny", flush=True)
        cases.append(case)
        multiples.append(case.seconds / canny)
    seconds = float(np.median([case.seconds for case in cases]))
    return Row(
        f"{SQUARES} squares, {false} of them false: time to the result",
        f"{seconds:.1f} s, {np.median(multiples):.0f} times `cv2.Canny`",
        f"<= {SECONDS_TARGET:.0f} s",
        seconds <= SECONDS_TARGET,
    )


def _silent_row() -> Row:
    cases = []
    for index in range(SCENES):
        case = from_edges(*drawn(EDGE_SQUARES, EDGE_FALSE, index))
        print(f"  edges, {EDGE_FALSE} false: {case}", flush=True)
        cases.append(case)
    wrong = [case for case in cases if case.wrong]
    silent = sum(not case.warned for case in wrong)
    refused = sum(bool(case.refusal) for case in cases)
    return Row(
        f"{SCENES} scenes of {EDGE_SQUARES} squares, {EDGE_FALSE} of them false: silently wrong",
        f"{silent} ({len(wrong)} wrong, {refused} refused)",
        "0",
        silent == 0,
    )
