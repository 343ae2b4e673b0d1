"""Blur, motion, noise, low contrast, JPEG and uneven light: squares found, and error.

Pictures of three squares or frames. Defocus and motion are in pixels, noise and contrast in grey
levels, JPEG is its quality. The errors are those of fx, fy, cx and cy. Silently wrong: fx is off by
more than 4 std and 1 %, without a warning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from finding.robustness import planes_of_targets
from harness.rows import Row
from harness.truth import PINHOLE, errors, rms

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene

SCENES = 30
SEED = 61
FOUND_TARGET = 0.98
COVERAGE_TARGET = 0.93
WRONG_STDS, WRONG_SHARE = 4.0, 0.01
"""Errors of a focal length, in standard deviations and as a fraction, beyond which it counts as
wrong. Without a warning, it is silently wrong."""
WITHIN_STDS = 3.0

MODERATE = {"blur": (0.5, 1.2), "noise": (1.0, 4.0), "contrast": (175.0, 175.0)}
"""Ranges of the properties that a condition does not state."""

CONDITIONS: Mapping[str, Mapping[str, Any]] = {
    "moderate": {},
    "defocus 2": {"blur": 2.0},
    "defocus 3": {"blur": 3.0},
    "defocus 4": {"blur": 4.0},
    "motion 7": {"motion": 7.0},
    "motion 14": {"motion": 14.0},
    "noise 4": {"noise": 4.0},
    "noise 6": {"noise": 6.0},
    "noise 8": {"noise": 8.0},
    "contrast 60": {"contrast": 60.0},
    "contrast 45": {"contrast": 45.0},
    "contrast 30": {"contrast": 30.0},
    "JPEG 60": {"jpeg_quality": 60},
    "JPEG 60, noise 4, defocus 2": {"jpeg_quality": 60, "noise": 4.0, "blur": 2.0},
    "JPEG 60, noise 8": {"jpeg_quality": 60, "noise": 8.0},
    "uneven light": {"shading": 0.6},
    "uneven light, contrast 60": {"shading": 0.6, "contrast": 60.0},
    "defocus 4, noise 8": {"blur": 4.0, "noise": 8.0},
    "motion 14, noise 8": {"motion": 14.0, "noise": 8.0},
    "contrast 30, noise 4": {"contrast": 30.0, "noise": 4.0},
    "contrast 30, defocus 4": {"contrast": 30.0, "blur": 4.0},
    "contrast 60, noise 8, defocus 4": {"contrast": 60.0, "noise": 8.0, "blur": 4.0},
    "contrast 30, noise 8": {"contrast": 30.0, "noise": 8.0},
    "contrast 30, noise 8, defocus 4": {"contrast": 30.0, "noise": 8.0, "blur": 4.0},
}
"""Single conditions and combinations."""

BEYOND = ("contrast 30, noise 8, defocus 4",)
"""Conditions without a row: a pixel of edge determines its position to 1 px only."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Outcome of one picture.

    Attributes
    ----------
    result : Calibration or None
        None where the calibration was refused; `reason` is the error.
    all_found : bool
        Whether the planes are the three targets and nothing else.
    deviations : ndarray of float64, shape (4,)
        Errors of fx, fy, cx, cy in stated standard deviations.
    over_bound : float
        Error of fx over the bound of all edge pixels.
    """

    result: ts.Calibration | None
    reason: str
    all_found: bool = False
    relative: float = 0.0
    deviations: np.ndarray = field(default_factory=lambda: np.zeros(4))
    over_bound: float = np.nan

    @property
    def silently_wrong(self) -> bool:
        """Return whether fx is off by far more than stated, without a warning."""
        if self.result is None or self.result.warnings:
            return False
        return abs(self.deviations[0]) > WRONG_STDS and self.relative > WRONG_SHARE


def shot(condition: str, index: int, seed: int = SEED) -> tuple[Image, Scene, float]:
    """Photograph a scene; also return the std of the position from one pixel of edge, in pixels."""
    number = list(CONDITIONS).index(condition)
    rng = np.random.default_rng([seed, number, index])
    kind = "frame" if rng.random() < 0.5 else "square"
    scene = simulate.random_scene(rng, kind=kind, dark=bool(rng.random() < 0.7))
    settings = {name: rng.uniform(*bounds) for name, bounds in MODERATE.items()}
    settings.update(CONDITIONS[condition])
    length = settings.get("motion", 0.0)
    sigma = simulate.pixel_sigma(
        settings["noise"], settings["contrast"], np.hypot(settings["blur"], length / np.sqrt(24.0))
    )
    if length:
        settings["motion"] = simulate.Motion(length, rng.uniform(0.0, 180.0))
    return simulate.render(scene, rng, tone="srgb", **settings), scene, sigma


def run_case(condition: str, index: int, seed: int = SEED) -> Case:
    """Photograph and calibrate one scene."""
    picture, scene, sigma = shot(condition, index, seed)
    try:
        result = ts.calibrate(picture)
    except ts.TrisquareError as error:
        return Case(None, f"{type(error).__name__}: {error}")
    error = errors(result, scene.camera)[: len(PINHOLE)]
    planes = planes_of_targets(result, scene)
    return Case(
        result,
        "",
        len(result.planes) == len(planes) and None not in planes,
        abs(error[0]) / scene.camera.fx,
        error / [result.std[name] for name in PINHOLE],
        error[0] / simulate.cramer_rao_bound(scene, sigma)["fx"],
    )


def summary(cases: list[Case]) -> str:
    """Return the outcomes of the cases in a line."""
    found = sum(case.all_found for case in cases)
    refused = sum(case.result is None for case in cases)
    wrong = sum(case.silently_wrong for case in cases)
    text = f"found {found}/{len(cases)}, refused {refused}, wrong {wrong}"
    measured = [case for case in cases if case.all_found]
    if not measured:
        return text
    deviations = np.array([case.deviations for case in measured])
    within = np.mean(np.abs(deviations) < WITHIN_STDS)
    over_bound = np.array([case.over_bound for case in measured])
    pixels = np.mean([case.result.stage == "pixels" for case in measured])
    percent = 100.0 * np.array([case.relative for case in measured])
    return (
        f"{text}; error / std {rms(deviations):.2f} ({within:.0%} within {WITHIN_STDS:.0f}), "
        f"/ bound {rms(over_bound):.2f} (median {np.median(np.abs(over_bound)):.2f}), fx off by "
        f"{np.median(percent):.2f} % (worst {percent.max():.1f}), pixels {pixels:.0%}"
    )


def measure() -> list[Row]:
    """Print a line per condition, and return a row for each except those of `BEYOND`."""
    rows = []
    for condition in CONDITIONS:
        cases = [run_case(condition, index) for index in range(SCENES)]
        print(f"  {condition:32s} {summary(cases)}", flush=True)
        if condition in BEYOND:
            continue
        found = sum(case.all_found for case in cases) / SCENES
        wrong = sum(case.silently_wrong for case in cases)
        deviations = np.array([case.deviations for case in cases if case.all_found])
        within = float(np.mean(np.abs(deviations) < WITHIN_STDS)) if len(deviations) else 0.0
        rows.append(
            Row(
                f"{condition}, {SCENES} pictures: found; silently wrong; errors within "
                f"{WITHIN_STDS:.0f} std",
                f"{found:.0%} found; {wrong}; {within:.0%}",
                f">= {FOUND_TARGET:.0%}; 0; >= {COVERAGE_TARGET:.0%}",
                found >= FOUND_TARGET and wrong == 0 and within >= COVERAGE_TARGET,
            )
        )
    return rows
