"""Pictures like photographs, of boards, squares among rectangles, and tags: results and error.

Without options. Right: fx, fy, cx and cy are each within 4 std or 1 % (cx and cy: 1 % of the
width). Silently wrong: not right, without a warning. The robust ratio is from the median.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from harness.rows import Row
from harness.truth import PINHOLE, errors, rms

import trisquare as ts
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene
from trisquare_scenes.photo_like import KINDS, real_picture

# `benchmarks/finding/real_scenes.py SEED` draws other pictures than those of the table. To add a
# kind of scene, add to `SUITE` a function that draws a `Case` from a generator.

PICTURES = 100
SEED = 41
WITHIN_STDS = 4.0
WITHIN_SHARE = 0.01
"""Limits of a right parameter: a number of its own stds, or a fraction of fx, fy or the width."""

FOUND_TARGET = 98
BOUND_TARGET = 1.3


class Case(Protocol):
    """A rendered picture with its truth."""

    @property
    def picture(self) -> Image:
        """The photograph."""

    @property
    def scene(self) -> Scene:
        """The scene in the photograph."""

    def bound(self) -> dict[str, float]:
        """Return the least stds that the pixels along visible edges allow."""


SUITE: Mapping[str, Callable[[np.random.Generator], Case]] = {
    kind: partial(real_picture, kind=kind) for kind in KINDS
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one picture.

    Attributes
    ----------
    verdict : str
        ``"right"``, ``"warned"`` (wrong, with a warning), ``"silent"`` (wrong without) or
        ``"refused"``.
    error, own : float
        Error of fx in units of the bound and of its stated std; NaN without an answer.
    planes, targets : int
        Number of planes of the result, and of targets in the scene.
    said : str
        The refusal, or the warnings.
    """

    verdict: str
    error: float
    own: float
    planes: int
    targets: int
    said: str


def outcome(case: Case) -> Outcome:
    """Calibrate one picture without options, and judge the answer."""
    targets = len(case.scene.targets)
    try:
        result = ts.calibrate(case.picture)
    except ts.TrisquareError as error:
        return Outcome("refused", np.nan, np.nan, 0, targets, f"{type(error).__name__}: {error}")
    truth = case.scene.camera
    error = errors(result, truth)[: len(PINHOLE)]
    std = np.array([result.std[name] for name in PINHOLE])
    width = truth.image_size[0]
    allowed = WITHIN_SHARE * np.array([truth.fx, truth.fy, width, width])
    right = bool(np.all(np.abs(error) <= np.maximum(WITHIN_STDS * std, allowed)))
    verdict = "right" if right else "warned" if result.warnings else "silent"
    return Outcome(
        verdict,
        float(error[0] / case.bound()["fx"]),
        float(error[0] / std[0]),
        len(result.planes),
        targets,
        "; ".join(result.warnings),
    )


def measure(seed: int = SEED) -> list[Row]:
    """Print a line for each kind of scene, and every picture that is not right."""
    outcomes: dict[str, list[Outcome]] = {kind: [] for kind in SUITE}
    kinds = list(SUITE)
    for index in range(PICTURES):
        kind = kinds[index % len(kinds)]
        done = outcome(SUITE[kind](np.random.default_rng([seed, index])))
        outcomes[kind].append(done)
        if done.verdict != "right" or done.planes != done.targets:
            planes = f"{done.planes} of {done.targets} planes"
            print(f"  {index} {kind}: {done.verdict}, {planes}: {done.said[:200]}", flush=True)
    print("  kind               right  all planes  fx error / bound (rms, robust)  / std (rms)")
    for kind, some in outcomes.items():
        print(f"  {kind:18s} {_summary(some)}")
    everything = [done for some in outcomes.values() for done in some]
    verdicts = Counter(done.verdict for done in everything)
    ratios = _answered([done.error for done in everything if done.planes == done.targets])
    ratio = rms(ratios) if len(ratios) else np.nan
    name = f"{PICTURES} pictures"
    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    silent = verdicts["silent"]
    return [
        Row(
            f"{name}: results",
            counts,
            f">= {FOUND_TARGET} right",
            verdicts["right"] >= FOUND_TARGET,
        ),
        Row(f"{name}: silently wrong", str(silent), "0", silent == 0),
        Row(
            f"{len(ratios)} pictures with all planes found: error / Cramer-Rao bound of fx",
            f"rms {ratio:.2f}, robust {_robust(ratios):.2f}",
            f"rms <= {BOUND_TARGET}",
            bool(ratio <= BOUND_TARGET),
        ),
    ]


def _answered(values: list[float]) -> np.ndarray:
    return np.array([value for value in values if np.isfinite(value)])


def _robust(ratios: np.ndarray) -> float:
    """Return the rms without outliers: from the median, as for a normal distribution."""
    return float(np.median(np.abs(ratios)) / 0.6745) if len(ratios) else np.nan


def _summary(some: list[Outcome]) -> str:
    right = sum(done.verdict == "right" for done in some)
    planes = sum(done.planes == done.targets for done in some)
    ratios = _answered([done.error for done in some])
    own = _answered([done.own for done in some])
    counts = f"{right:2d}/{len(some):2d}    {planes:2d}"
    if not len(ratios):
        return counts
    return f"{counts}          {rms(ratios):5.2f} {_robust(ratios):5.2f}   {rms(own):5.2f}"


if __name__ == "__main__":
    for row in measure(*(int(argument) for argument in sys.argv[1:])):
        print(row)
