"""Lens model chosen by evidence: how often it is right, and its effect on fx.

Three squares from edge points; the true lenses have the models `none` to `brown`. "Beyond 4 std"
are lenses with a coefficient of their own of more than 4 times its Cramer-Rao bound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from harness.rows import Row
from harness.truth import Array

import trisquare as ts
from trisquare import simulate
from trisquare.camera.lens_models import BROWN, is_fisheye
from trisquare.camera.lens_models import COEFFICIENTS as LENS_MODELS
from trisquare.simulate.scene import Scene, TrueCamera

SCENES = 100
SEED = 11
NOISE_RANGE = (0.05, 0.5)  # pixels
SPACING = 4.0
SIZE = (1280, 960)
COEFFICIENTS = ("k1", "k2", "k3", "p1", "p2")
KINDS = [model for model, coefficients in LENS_MODELS.items() if coefficients == BROWN]
COUNT = dict(zip(KINDS, (0, 1, 2, 3, 5), strict=True))
FISHEYE_FIELD_RANGE = (80.0, 200.0)  # degrees across the picture's width
MAX_WRONG_FAMILY = 0.03
# A coefficient this many standard deviations from zero is detectable.
DETECTABLE = 4.0
MAX_WRONGLY_RICHER = 0.03
MIN_FOUND = 0.97
# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964
COVERAGE = (0.93, 0.97)
COVERAGE_TEXT = f"{100 * COVERAGE[0]:.0f}-{100 * COVERAGE[1]:.0f} %"


@dataclass
class Tally:
    """Outcomes for the scenes of one kind of lens."""

    chosen: Counter[str] = field(default_factory=Counter)
    richer: int = 0
    detectable: int = 0
    found: int = 0
    # Of the models auto and radial2: error of fx over the bound for radial2, and whether the 95 %
    # interval contains the truth.
    errors: list[tuple[float, float]] = field(default_factory=list)
    covered: list[tuple[bool, bool]] = field(default_factory=list)


def measure() -> list[Row]:
    """Print the confusion table; lenses are the usual ones except for their coefficients."""
    tallies = {kind: _tally(kind) for kind in KINDS}
    outside = _outside()
    missed, fisheye_coverage = _fisheyes()
    print(f"  {'true lens':14}" + "".join(f"{model:>9}" for model in KINDS) + "   rms error of fx")
    for kind, tally in tallies.items():
        counts = "".join(f"{tally.chosen[model]:9}" for model in KINDS)
        auto, usual = np.sqrt((np.array(tally.errors) ** 2).mean(axis=0))
        covered = 100 * np.array(tally.covered).mean(axis=0)
        print(
            f"  {kind:14}{counts}   auto {auto:.2f}, radial2 {usual:.2f} of the bound; coverage "
            f"{covered[0]:.0f} %, {covered[1]:.0f} %; detectable {tally.detectable}"
        )
    print(f"  {'division':14}" + "".join(f"{outside[model]:9}" for model in KINDS))
    scenes = sum(tally.chosen.total() for tally in tallies.values())
    richer = sum(tally.richer for tally in tallies.values()) / scenes
    found = sum(t.found for t in tallies.values()) / sum(t.detectable for t in tallies.values())
    errors = np.array([pair for tally in tallies.values() for pair in tally.errors])
    auto, usual = np.sqrt((errors**2).mean(axis=0))
    covered = np.array([pair for t in tallies.values() for pair in t.covered]).mean(axis=0)
    low, high = FISHEYE_FIELD_RANGE
    fisheyes = f"{SCENES} fisheyes of {low:.0f}-{high:.0f} degrees"
    return [
        Row(
            f"{scenes} lenses of {len(KINDS)} models: chosen model richer than the true one",
            f"{100 * richer:.1f} %",
            f"<= {100 * MAX_WRONGLY_RICHER:.0f} %",
            richer <= MAX_WRONGLY_RICHER,
        ),
        Row(
            f"lenses beyond {DETECTABLE:.0f} std: true model or a richer one chosen",
            f"{100 * found:.0f} %",
            f">= {100 * MIN_FOUND:.0f} %",
            found >= MIN_FOUND,
        ),
        Row(
            f"{scenes} lenses: rms error of fx, `auto` / `radial2`",
            f"{auto / usual:.2f}",
            "<= 1",
            bool(auto <= usual),
        ),
        Row(
            f"{scenes} lenses: coverage of the 95 % intervals of fx, `auto` (`radial2`)",
            f"{100 * covered[0]:.1f} % ({100 * covered[1]:.1f} %)",
            COVERAGE_TEXT,
            bool(COVERAGE[0] <= covered[0] <= COVERAGE[1]),
        ),
        Row(
            f"{fisheyes}: another lens model chosen, and fx off by more than {DETECTABLE:.0f} std",
            f"{missed}",
            f"<= {MAX_WRONG_FAMILY * SCENES:.0f}",
            missed <= MAX_WRONG_FAMILY * SCENES,
        ),
        Row(
            f"{fisheyes}: coverage of the 95 % intervals of fx",
            f"{100 * fisheye_coverage:.1f} %",
            COVERAGE_TEXT,
            bool(COVERAGE[0] <= fisheye_coverage <= COVERAGE[1]),
        ),
    ]


def _fisheyes() -> tuple[int, float]:
    """Count fisheyes whose fx is wrong because of another model; also return the coverage."""
    missed, covered = 0, []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, len(KINDS) + 1, number])
        bend = rng.choice([0.0, 1.0]) * np.array([0.02, -0.01, 0.003, -0.0004])
        scene = simulate.wide_scene(rng, simulate.fisheye(rng.uniform(*FISHEYE_FIELD_RANGE), bend))
        edges = _edges(scene, rng, rng.uniform(*NOISE_RANGE))
        result = ts.calibrate_edges(edges, SIZE, model="auto")
        error = abs(result.camera.fx - scene.camera.fx) / result.std["fx"]
        missed += not is_fisheye(result.camera.model) and error > DETECTABLE
        covered.append(error <= HALF_WIDTH)
    return missed, float(np.mean(covered))


def _tally(kind: str) -> Tally:
    tally = Tally()
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, KINDS.index(kind), number])
        scene = _scene(rng, lambda rng: _coefficients(rng, kind))
        noise = rng.uniform(*NOISE_RANGE)
        edges = _edges(scene, rng, noise)
        try:
            auto = ts.calibrate_edges(edges, SIZE, model="auto")
            usual = ts.calibrate_edges(edges, SIZE)
        except ts.DegenerateGeometryError:  # a weak scene, rightly refused
            continue
        model = auto.camera.model
        tally.chosen[model] += 1
        tally.richer += is_fisheye(model) or COUNT[model] > COUNT[kind]
        if _is_detectable(scene, noise, kind):
            tally.detectable += 1
            tally.found += is_fisheye(model) or COUNT[model] >= COUNT[kind]
        bound = simulate.cramer_rao_bound(scene, noise, spacing=SPACING)["fx"]
        errors = [result.camera.fx - scene.camera.fx for result in (auto, usual)]
        tally.errors.append((errors[0] / bound, errors[1] / bound))
        stds = (auto.std["fx"], usual.std["fx"])
        first, second = (bool(abs(e) <= HALF_WIDTH * s) for e, s in zip(errors, stds, strict=True))
        tally.covered.append((first, second))
    return tally


def _outside() -> Counter[str]:
    """Count the models chosen for division lenses, which are outside all models."""
    chosen: Counter[str] = Counter()
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, len(KINDS), number])
        scene = _scene(rng, lambda rng: _coefficients(rng, "none"))
        strength = rng.uniform(-0.4, -0.1)
        sides = [
            ts.PlaneEdges.square([_divided(points, scene.camera, strength) for points in four])
            for four in simulate.edge_points(scene, rng, noise=0.1, spacing=SPACING)
        ]
        chosen[ts.calibrate_edges(sides, SIZE, model="auto").camera.model] += 1
    return chosen


def _divided(points: Array, camera: TrueCamera, strength: float) -> Array:
    """Distort a pinhole's pixels by `r_u = r_d / (1 + strength r_d^2)`."""
    offset = (points - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    ideal = np.linalg.norm(offset, axis=1, keepdims=True)
    # The smaller root of strength r_u r_d^2 - r_d + r_u = 0, in a form without cancellation.
    observed = 2.0 * ideal / (1.0 + np.sqrt(1.0 - 4.0 * strength * ideal**2))
    bent = offset * (observed / ideal) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return np.asarray(bent)


def _edges(scene: Scene, rng: np.random.Generator, noise: float) -> list[ts.PlaneEdges]:
    points = simulate.edge_points(scene, rng, noise=noise, spacing=SPACING)
    return [ts.PlaneEdges.square(sides) for sides in points]


def _scene(rng: np.random.Generator, lens: Callable[[np.random.Generator], Array]) -> Scene:
    """Draw three squares and a usual camera with coefficients from `lens`."""
    width, height = SIZE
    while True:
        fx = width * rng.uniform(0.65, 1.3)
        fy = fx * rng.uniform(0.995, 1.005)
        cx, cy = rng.normal([(width - 1) / 2, (height - 1) / 2], 0.012 * width)
        camera = TrueCamera(fx, fy, cx, cy, lens(rng), SIZE)
        if camera.is_monotonic():
            try:
                return simulate.random_scene(rng, camera=camera)
            except ValueError:  # no three squares fit this camera's picture
                continue


def _coefficients(rng: np.random.Generator, kind: str) -> Array:
    """Draw ``k1, k2, p1, p2, k3`` for a kind of lens."""
    k1 = rng.uniform(-0.32, 0.12) if kind != "none" else 0.0
    k2 = abs(k1) * rng.uniform(0.0, 0.35) if COUNT[kind] > 1 else 0.0
    k3 = 0.0
    if kind == "radial3":
        k2, k3 = rng.uniform(-0.2, 0.3), rng.uniform(-0.3, 0.3)
    p1, p2 = rng.normal(0.0, 0.002, 2) if kind == "brown" else (0.0, 0.0)
    return np.array([k1, k2, p1, p2, k3])


def _is_detectable(scene: Scene, noise: float, kind: str) -> bool:
    """Return whether a coefficient that only this kind has is far from zero, by the bound."""
    if kind == "none":
        return False
    free = ("fx", "fy", "cx", "cy", *COEFFICIENTS[: COUNT[kind]])
    bound = simulate.cramer_rao_bound(scene, noise, spacing=SPACING, free=free)
    k1, k2, p1, p2, k3 = scene.camera.distortion
    values = {"k1": k1, "k2": k2, "k3": k3, "p1": p1, "p2": p2}
    own = {"radial1": ("k1",), "radial2": ("k2",), "radial3": ("k3",), "brown": ("p1", "p2")}
    return max(abs(values[name]) / bound[name] for name in own[kind]) > DETECTABLE
