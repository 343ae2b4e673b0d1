"""Straight lines of the scene in addition to three small squares, from edge points.

The squares are in the middle of the picture. Wrong: any of fx, fy, cx, cy, k1 and k2 is off by more
than 4 std.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from harness.rows import Row, bound_row, coverage_row
from harness.truth import NAMES, Array, by_name, errors, rms

import trisquare as ts
from trisquare import simulate
from trisquare_scenes.scene_lines import (
    central_scene,
    imaged_lines,
    line_information,
    line_samples,
)

SCENES = 200
SEED = 131
NOISE = 0.1  # pixels
SPACING = 4.0
LINES = 12
BENT = (2, 5, 9)
SAGITTA_RANGE = (1.0, 5.0)  # pixels
MAX_OVER_BOUND = 1.10
COVERAGE = (0.93, 0.97)
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964
WRONG_STDS = 4.0
"""Error, in standard deviations, that no sound calibration has."""


class Found(NamedTuple):
    """Errors and standard deviations of a calibration relative to the bound, shape (6,)."""

    error: Array
    std: Array
    bound: Array
    rejected: set[int]


def measure() -> list[Row]:
    """Print the effect of lines on the standard deviations, and that of bent lines."""
    runs: dict[str, list[Found]] = {"without": [], "with": [], "bent": []}
    for number in range(SCENES):
        for name, found in _of_scene(number).items():
            runs[name].append(found)
    for name, found in runs.items():
        medians = np.median([one.std for one in found], axis=0)
        stds = ", ".join(f"{key} {std:.2g}" for key, std in zip(NAMES, medians, strict=True))
        print(f"  {name}: median std {stds}; coverage {100 * _coverage(found):.1f} %")
    ratio, share = _ratio(runs["with"]), _coverage(runs["with"])
    straight = sum(len(one.rejected) for one in runs["with"])
    hits = sum(len(one.rejected & set(BENT)) for one in runs["bent"])
    losses = sum(len(one.rejected - set(BENT)) for one in runs["bent"])
    wrong = sum(bool(np.any(np.abs(one.error) > WRONG_STDS * one.std)) for one in runs["bent"])
    gains = np.median(
        [
            other.std[4:] / one.std[4:]
            for one, other in zip(runs["with"], runs["without"], strict=True)
        ],
        axis=0,
    )
    scenes = f"squares and {LINES} lines, {SCENES} scenes"
    bends = f"{SAGITTA_RANGE[0]:.0f}-{SAGITTA_RANGE[1]:.0f} px"
    return [
        bound_row(
            scenes,
            ratio,
            MAX_OVER_BOUND,
            f" (squares alone {_ratio(runs['without']):.3f})",
        ),
        coverage_row(scenes, share, COVERAGE),
        Row(
            f"{scenes}: std of k1 and of k2 without lines / with lines, median; lines rejected",
            f"{gains[0]:.0f}, {gains[1]:.0f}; {straight}",
            "",
            None,
        ),
        Row(
            f"{scenes}, {len(BENT)} lines bent by {bends}: bent, straight lines rejected; wrong; "
            "coverage of the 95 % intervals",
            f"{hits} of {len(BENT) * SCENES}, {losses}; {wrong}; "
            f"{100 * _coverage(runs['bent']):.1f} %",
            "all; 0",
            hits == len(BENT) * SCENES and wrong == 0,
        ),
    ]


def _of_scene(number: int) -> dict[str, Found]:
    rng = np.random.default_rng([SEED, number])
    scene = central_scene(rng)
    sides = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    squares = [ts.PlaneEdges.square(own) for own in sides]
    lines = imaged_lines(scene.camera, rng, LINES)
    information = line_information(scene.camera, lines, NOISE, NAMES)
    bends = [rng.choice([-1, 1]) * rng.uniform(*SAGITTA_RANGE) * (i in BENT) for i in range(LINES)]
    straight = [ts.PlaneEdges.line(line_samples(line, rng, NOISE)) for line in lines]
    bent = [
        ts.PlaneEdges.line(line_samples(line, rng, NOISE, bend))
        for line, bend in zip(lines, bends, strict=True)
    ]

    def found(edges: list[ts.PlaneEdges], further: Array | None) -> Found:
        result = ts.calibrate_edges([*squares, *edges], scene.camera.image_size)
        bound = simulate.cramer_rao_bound(scene, NOISE, spacing=SPACING, further=further)
        rejected = {i for i, line in enumerate(result.lines) if not line.is_used}
        error = errors(result, scene.camera)
        return Found(error, by_name(result.std), by_name(bound), rejected)

    return {
        "without": found([], None),
        "with": found(straight, information),
        "bent": found(bent, information),
    }


def _ratio(found: list[Found]) -> float:
    return rms(np.array([one.error / one.bound for one in found]))


def _coverage(found: list[Found]) -> float:
    return float(np.mean([np.abs(one.error) <= HALF_WIDTH * one.std for one in found]))
