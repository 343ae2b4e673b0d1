"""Pictures with one damaged or false target: error, and warnings that name it.

The errors are those of fx, fy, cx, cy, k1 and k2. A false warning is one that names a plane or a
side. One false target of three cannot be identified in general.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from harness.rows import Row
from harness.truth import NAMES, Array, errors

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene, sample_sides
from trisquare_scenes.damage import KINDS, Damage, DamageKind, damaged_scene

CASES_PER_KIND = 25
CLEAN_PICTURES = 50
SEED = 21
WITHIN_STDS = 3.0
WITHIN_TARGET = 0.95
SAME_CENTRE = 50.0
"""Maximum distance, in pixels, between a target's true centre and that of its plane. A square
fitted to a trapezium is off by some 20, and other targets are 200 away."""


@dataclass(frozen=True, slots=True)
class Case:
    """Outcome of one damaged picture.

    Attributes
    ----------
    result : Calibration or None
        None where the calibration was refused; `reason` is the error.
    planes_found, targets : int
        Number of planes of the result that are targets, and number of targets.
    worst : float
        The largest error of fx, fy, cx, cy, k1, k2, in stated standard deviations.
    mahalanobis : float
        Root mean square of the errors in units of the stated covariance, per parameter.
    names_plane, names_side : bool
        Whether a warning names the damaged plane, and whether it also names the side.
    """

    damage: Damage
    result: ts.Calibration | None
    reason: str
    planes_found: int
    targets: int
    worst: float = np.inf
    mahalanobis: float = np.inf
    names_plane: bool = False
    names_side: bool = False


def run_case(kind: DamageKind, index: int) -> Case:
    """Draw, photograph and calibrate one damaged scene."""
    rng = np.random.default_rng([SEED, KINDS.index(kind), index])
    picture, scene, damage = damaged_scene(rng, kind)
    count = len(scene.targets)
    try:
        result = ts.calibrate(picture)
    except ts.TrisquareError as error:
        return Case(damage, None, f"{type(error).__name__}: {error}", 0, count)
    planes = planes_of_targets(result, scene)
    found = sum(plane is not None for plane in planes)
    worst, mahalanobis = deviations(result, scene)
    names_plane, names_side = named(result, scene, damage, planes[damage.plane])
    return Case(damage, result, "", found, count, worst, mahalanobis, names_plane, names_side)


def deviations(result: ts.Calibration, scene: Scene) -> tuple[float, float]:
    """Return the worst error in its own std, and the rms Mahalanobis distance per parameter."""
    error = errors(result, scene.camera)
    std = np.array([result.std[name] for name in NAMES])
    order = [result.parameters.index(name) for name in NAMES]
    covariance = result.covariance[np.ix_(order, order)]
    square = float(error @ np.linalg.solve(covariance, error))
    return float(np.abs(error / std).max()), float(np.sqrt(square / len(NAMES)))


def planes_of_targets(result: ts.Calibration, scene: Scene) -> list[int | None]:
    """Return, per target, the index of the plane that shows it."""
    centres = np.array([plane.corners.mean(axis=0) for plane in result.planes])
    places: list[int | None] = []
    for index, target in enumerate(scene.targets):
        centre = scene.image_points(index, target.outlines()[0]).mean(axis=0)
        gaps = np.linalg.norm(centres - centre, axis=1)
        nearest = int(gaps.argmin())
        places.append(nearest if gaps[nearest] < SAME_CENTRE else None)
    return places


def named(
    result: ts.Calibration, scene: Scene, damage: Damage, plane: int | None
) -> tuple[bool, bool]:
    """Return whether a warning names the damaged plane, and whether it also names the side."""
    if plane is None:
        return False, False
    about = [text for text in result.warnings if re.search(rf"\bplane {plane}\b", text)]
    if damage.side is None:
        return bool(about), bool(about)
    side = _measured_side(result.planes[plane].corners, scene, damage.plane, damage.side)
    return bool(about), any(re.search(rf"\bside {side}\b", text) for text in about)


def _measured_side(corners: Array, scene: Scene, target: int, side: int) -> int:
    """Return the index of a target's side on its measured plane; side i follows corner i."""
    true_side = sample_sides(scene.camera, scene.targets[target], 4.0)[side].image
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    return int(np.linalg.norm(middles - true_side.mean(axis=0), axis=1).argmin())


def false_warnings() -> tuple[int, list[str]]:
    """Count undamaged pictures with a warning that names a plane or a side, and list them."""
    found = []
    for index in range(CLEAN_PICTURES):
        rng = np.random.default_rng([SEED, len(KINDS), index])
        result = ts.calibrate(simulate.photo_like(rng)[0])
        texts = [text for text in result.warnings if re.search(r"\b(plane|side) \d", text)]
        if texts:
            found.append(f"{index}: {'; '.join(texts)}")
    return len(found), found


def measure() -> list[Row]:
    """Print a line per kind of damage, and count the undamaged pictures with such a warning."""
    rows, cases = [], []
    print("  kind            found all  within 3 std  worst (median, max)  rms  plane, side named")
    for kind in KINDS:
        some = [run_case(kind, index) for index in range(CASES_PER_KIND)]
        cases += some
        print("  " + _summary(kind, some), flush=True)
    # A false one of three cannot be identified in general: these cases have a row of their own.
    decidable = [case for case in cases if case.damage.kind != "false_of_three"]
    three = [case for case in cases if case.damage.kind == "false_of_three"]
    name = f"{len(decidable)} pictures with one damaged side or false target"
    rows.append(
        _within(f"{name}: all errors within {WITHIN_STDS:.0f} std", decidable, WITHIN_TARGET)
    )
    with_side = sum(case.names_side for case in decidable)
    rows.append(Row(f"{name}: plane and side named", f"{with_side / len(decidable):.0%}", "", None))
    warned = sum(case.names_plane or case.result is None for case in three)
    rows.append(
        Row(
            f"{len(three)} pictures with one false target of three: warned or refused",
            f"{warned / len(three):.0%}",
            "",
            None,
        )
    )
    count, texts = false_warnings()
    for text in texts:
        print(f"  false warning {text}")
    name = f"{CLEAN_PICTURES} undamaged pictures: false warnings"
    rows.append(Row(name, str(count), "<= 1", count <= 1))
    return rows


def _within(name: str, cases: list[Case], target: float) -> Row:
    share = np.mean([case.worst <= WITHIN_STDS for case in cases])
    return Row(name, f"{share:.1%}", f">= {target:.0%}", bool(share >= target))


def _summary(kind: str, cases: list[Case]) -> str:
    worst = np.array([case.worst for case in cases if case.result is not None])
    rms = np.array([case.mahalanobis for case in cases if case.result is not None])
    whole = sum(case.planes_found == case.targets for case in cases)
    within = sum(case.worst <= WITHIN_STDS for case in cases)
    plane, side = sum(c.names_plane for c in cases), sum(c.names_side for c in cases)
    n = len(cases)
    spread = (
        f"{np.median(worst):6.1f} {worst.max():8.1f}  {np.median(rms):5.1f}" if len(worst) else ""
    )
    return f"{kind:15s} {whole:3d}/{n}   {within:3d}/{n}   {spread}   {plane:3d} {side:3d}"
