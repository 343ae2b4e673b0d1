"""Refusals: scenes that determine the camera, and scenes that do not.

From edge points, except for the pictures. Held parameters are fixed at the truth. Wrong: any
parameter is off by more than 4 std; right: answered and not wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

import numpy as np
from accuracy.planned_scenes import alike_scene, camera_of, edges_of
from harness.rows import Row
from harness.truth import NAMES, errors

import trisquare as ts
from trisquare import simulate

SCENES = 500
SOME = 100
RENDERED = 60
SEED = 21
NOISE_RANGE = (0.05, 0.5)  # pixels, samples 4 px apart
STRONG_NOISE = (0.5, 1.5)
RENDERED_NOISE = (1.0, 4.0)  # grey levels
RENDERED_BLUR = (0.5, 1.2)  # pixels
# Maximum error of a right answer in its own standard deviations.
MAX_SIGMAS = 4.0

Outcome = tuple[str, float]


def measure() -> list[Row]:
    """Print the outcomes for every kind of scene."""
    usual = _outcomes(lambda rng: simulate.random_scene(rng))
    strong = _outcomes(lambda rng: simulate.random_scene(rng), noise_range=STRONG_NOISE)
    rendered = [_rendered(seed) for seed in range(RENDERED)]
    parallel = _outcomes(alike_scene)
    exact = _outcomes(alike_scene, noise_range=(1e-6, 1e-6), scenes=SOME)
    held = _outcomes(alike_scene, fix=("principal_point",))
    both = _outcomes(alike_scene, fix=("principal_point", "aspect"))
    for degrees in (1.0, 2.0, 3.0, 5.0):
        near = partial(alike_scene, apart=degrees)
        _print(f"planes {degrees:g} degrees apart", _outcomes(near, scenes=SOME))
    _print("planes that all face the camera", _outcomes(_facing, scenes=SOME))
    _print("squares of a tenth of the picture's height", _outcomes(_small, scenes=SOME))
    refused = Counter(kind for kind, _ in held)["DegenerateGeometryError"]
    return [
        _all(f"{SCENES} scenes, noise 0.05-0.5 px: answered", usual, "answered"),
        _all(f"{SCENES} scenes, noise 0.5-1.5 px: answered", strong, "answered"),
        _all(f"{RENDERED} pictures: answered", rendered, "answered"),
        _all(f"{SCENES} scenes of parallel planes: refused", parallel, "DegenerateGeometryError"),
        _all(
            f"{SOME} scenes of parallel planes, without noise: refused",
            exact,
            "DegenerateGeometryError",
        ),
        Row(
            f"{SCENES} scenes of parallel planes, principal point held: wrong",
            f"{_wrong(held)} ({refused} refused: tilt axis along the rows or columns)",
            "0",
            _wrong(held) == 0,
        ),
        Row(
            f"{SCENES} scenes of parallel planes, principal point and aspect held: right",
            f"{SCENES - _wrong(both) - Counter(k for k, _ in both)['DegenerateGeometryError']}",
            str(SCENES),
            all(kind == "answered" and sigmas <= MAX_SIGMAS for kind, sigmas in both),
        ),
    ]


def _outcomes(
    draw: Callable[[np.random.Generator], simulate.Scene],
    *,
    noise_range: tuple[float, float] = NOISE_RANGE,
    fix: tuple[str, ...] = (),
    scenes: int = SCENES,
) -> list[Outcome]:
    """Calibrate edge samples of `scenes` scenes; fixed parameters are held at the truth."""
    outcomes = []
    for seed in range(scenes):
        rng = np.random.default_rng([SEED, seed])
        scene = draw(rng)
        edges = edges_of(scene, rng, rng.uniform(*noise_range))
        initial = camera_of(scene.camera) if fix else None
        calibrate = partial(
            ts.calibrate_edges, edges, scene.camera.image_size, fix=fix, initial=initial
        )
        outcomes.append(_answer(scene, calibrate))
    return outcomes


def _rendered(seed: int) -> Outcome:
    rng = np.random.default_rng([SEED, seed])
    scene = simulate.random_scene(rng)
    noise, blur = rng.uniform(*RENDERED_NOISE), rng.uniform(*RENDERED_BLUR)
    picture = simulate.render(scene, rng, noise=noise, blur=blur, tone="linear")
    return _answer(scene, lambda: ts.calibrate(picture, tone="linear"))


def _answer(scene: simulate.Scene, calibrate: Callable[[], ts.Calibration]) -> Outcome:
    """Return the outcome of a calibration, and its largest error in its own standard deviations."""
    try:
        result = calibrate()
    except ts.TrisquareError as error:
        return type(error).__name__, 0.0
    std = np.array([result.std.get(name, 0.0) for name in NAMES])
    error = np.abs(errors(result, scene.camera))
    free = std > 0.0
    return "answered", float((error[free] / std[free]).max())


def _facing(rng: np.random.Generator) -> simulate.Scene:
    return alike_scene(rng, tilt=(0.0, 3.0))


def _small(rng: np.random.Generator) -> simulate.Scene:
    return alike_scene(rng, tilt=(0.0, 1.0), apart=50.0, scale=0.3)


def _wrong(outcomes: list[Outcome]) -> int:
    return sum(sigmas > MAX_SIGMAS for _, sigmas in outcomes)


def _print(name: str, outcomes: list[Outcome]) -> None:
    counts = Counter(kind for kind, _ in outcomes)
    shown = ", ".join(f"{kind} {count}" for kind, count in counts.most_common())
    worst = max(sigmas for _, sigmas in outcomes)
    print(f"  {name}: {shown}; largest error {worst:.1f} std")


def _all(name: str, outcomes: list[Outcome], wanted: str) -> Row:
    _print(name, outcomes)
    count = sum(kind == wanted for kind, _ in outcomes)
    return Row(name, str(count), str(len(outcomes)), count == len(outcomes))
