"""Rectangles: A4 sheets in pictures; rectangles of unknown aspect from edge points.

Silently wrong: fx is off by more than 4 std and 0.3 %, and there is no warning above low severity.
From edge points, the aspects of the rectangles, facades and faces are estimated, and the coverage
includes them. fy / fx is fixed, and for the rectangles and facades the principal point as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from harness.rows import Row, bound_row, coverage_row
from harness.truth import rms

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.render import Image
from trisquare_scenes.boards import with_boards

SCENES = 60
EDGE_SCENES = 200
SEED = 73
ASPECT_RANGE = (1.0, 2.0)
# Number of lines along Y and along X of a facade.
FACADE = (4, 3)
NOISE = 0.1  # pixels
SPACING = 4.0  # pixels of edge per sample
MIN_FOUND = 55
MAX_ERROR = 0.0002
MAX_OVER_BOUND = 1.10
# An answer is wrong where its error exceeds both limits.
WRONG_STDS = 4.0
WRONG_PART = 0.003
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964
COVERAGE = (0.93, 0.97)

Photograph: TypeAlias = tuple[Image, simulate.Scene, dict[str, Any]]
# A scene, the edges of its targets, and the true aspect.
Measured: TypeAlias = tuple[simulate.Scene, list[ts.PlaneEdges], float]


def measure() -> list[Row]:
    """Print how many sheets of paper are found, and the errors relative to the edges' bound."""
    on_paper, bare = _sheets(_on_paper), _sheets(simulate.photo_of_sheets)
    scenes = f"{EDGE_SCENES} scenes"
    facades = f"three facades of {FACADE[1]} and {FACADE[0]} lines, {scenes}"
    box = f"three faces of a box, {scenes}"
    return [
        *_sheet_rows(f"A4 rectangles on paper, {SCENES} pictures", *on_paper),
        *_sheet_rows(f"A4 sheets directly on the clutter, {SCENES} pictures", *bare),
        *_bound_rows(f"three rectangles, {scenes}", *_over_bound(_rectangles, any_aspect=True)),
        *_bound_rows(facades, *_over_bound(_facades, any_offsets=True)),
        *_bound_rows(box, *_over_bound(_box_corners, ("aspect",), any_aspect=True)),
        *_bound_rows(f"{box}, right angles given", *_over_bound_of_right_angles()),
    ]


def _sheet_rows(name: str, found: int, error: float, silent: int) -> list[Row]:
    """Return the rows of the sheets found, of the error of fx, and of the silently wrong."""
    return [
        Row(f"{name}: all three found", f"{found}", f">= {MIN_FOUND}", found >= MIN_FOUND),
        Row(
            f"{name}: median error of fx",
            f"{100 * error:.4f} %",
            f"<= {100 * MAX_ERROR:.2f} %",
            error <= MAX_ERROR,
        ),
        Row(f"{name}: silently wrong", f"{silent}", "0", silent == 0),
    ]


def _bound_rows(name: str, ratio: float, share: float) -> list[Row]:
    """Return the rows of an error over its bound, and of the coverage of the intervals."""
    return [bound_row(name, ratio, MAX_OVER_BOUND), coverage_row(name, share, COVERAGE)]


def _over_bound_of_right_angles() -> tuple[float, float]:
    pairs = ((0, 1), (1, 2), (0, 2))
    return _over_bound(_box_corners, ("aspect",), orthogonal=pairs, any_aspect=True)


def _on_paper(rng: np.random.Generator) -> Photograph:
    """Photograph A4 rectangles on larger sheets of paper."""
    return simulate.photo_of_sheets(rng, rim=None, dark=bool(rng.random() < 0.5))


def _sheets(photograph: Callable[[np.random.Generator], Photograph]) -> tuple[int, float, int]:
    """Count the scenes with all sheets found, the median error of fx, and the silently wrong."""
    found, wrong, errors = 0, 0, []
    for number in range(SCENES):
        picture, scene, _ = photograph(np.random.default_rng([SEED, number]))
        try:
            result = ts.calibrate(picture, targets="a4")
        except ts.TrisquareError as error:
            print(f"  scene {number}: {type(error).__name__}")
            continue
        found += len(result.planes) == len(scene.targets)
        off = abs(result.camera.fx - scene.camera.fx)
        errors.append(off / scene.camera.fx)
        is_wrong = off > WRONG_STDS * result.std["fx"] and errors[-1] > WRONG_PART
        wrong += is_wrong and all(warning.severity == "low" for warning in result.warnings)
    return found, float(np.median(errors)), wrong


def _rectangles(rng: np.random.Generator, camera: simulate.TrueCamera) -> Measured:
    """Sample three rectangles of one aspect."""
    aspect = rng.uniform(*ASPECT_RANGE)
    scene = simulate.random_scene(rng, camera=camera, aspect=aspect)
    points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    return scene, [ts.PlaneEdges.rectangle(sides, None) for sides in points], aspect


def _box_corners(rng: np.random.Generator, camera: simulate.TrueCamera) -> Measured:
    """Sample a square on each of three planes that meet at right angles."""
    corner = simulate.corner_scene(rng, camera=camera)
    targets = tuple(replace(target, kind="square") for target in corner.targets)
    scene = replace(corner, targets=targets)
    points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    return scene, [ts.PlaneEdges.rectangle(sides, None) for sides in points], 1.0


def _facades(rng: np.random.Generator, camera: simulate.TrueCamera) -> Measured:
    """Sample three facades, whose lines are the inner lines of boards."""
    across, down = FACADE
    squares = simulate.random_scene(rng, camera=camera)
    scene = with_boards(squares, FACADE, max(FACADE) - 1)
    points = simulate.edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    edges = [ts.PlaneEdges.families(lines[:down], lines[down:]) for lines in points]
    return scene, edges, (across - 1) / (down - 1)


def _over_bound(
    measured: Callable[[np.random.Generator, simulate.TrueCamera], Measured],
    fix: tuple[str, ...] = ("principal_point", "aspect"),
    orthogonal: Sequence[tuple[int, int]] = (),
    **unknown: bool,
) -> tuple[float, float]:
    """Return error / bound of the free parameters, and the coverage of these and of the aspects."""
    centre = () if "principal_point" in fix else ("cx", "cy")
    names = ("f", *centre, "k1", "k2")
    ratios, covered = [], []
    for number in range(EDGE_SCENES):
        rng = np.random.default_rng([SEED, 1, number])
        camera = simulate.random_camera(rng)
        cx, cy = (0.5 * (extent - 1.0) for extent in camera.image_size)
        camera = replace(camera, fy=camera.fx, cx=cx, cy=cy)
        scene, edges, aspect = measured(rng, camera)
        result = ts.calibrate_edges(edges, camera.image_size, fix=fix, orthogonal=orthogonal)
        found = [getattr(result.camera, name) for name in ("fx", *centre)]
        true = [getattr(camera, name) for name in ("fx", *centre)]
        errors = np.append(
            np.subtract(found, true), result.camera.distortion[:2] - camera.distortion[:2]
        )
        bound = simulate.cramer_rao_bound(
            scene, NOISE, spacing=SPACING, free=names, orthogonal=orthogonal, **unknown
        )
        ratios.append(errors / [bound[name] for name in names])
        std = [result.std[name] for name in ("fx", *centre, "k1", "k2")]
        covered += (np.abs(errors) <= HALF_WIDTH * np.array(std)).tolist()
        covered += [
            abs(plane.aspect - aspect) <= HALF_WIDTH * plane.aspect_std
            for plane in result.planes
            if plane.aspect is not None and plane.aspect_std is not None
        ]
    return rms(np.array(ratios)), float(np.mean(covered))
