"""Wide lenses fitted with `radial3` and `brown`: error and cost.

A model with more coefficients must not have a larger cost than `radial2` for the same edge points.
The focal length is 0.35-0.5 of the width.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from harness.rows import Row
from harness.truth import Array

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene, TrueCamera

SCENES = 60
SEED = 23
SIZE = (1280, 960)
SPACING = 6.0
NOISE_RANGE = (0.05, 0.3)  # pixels
PICTURES = (1, 2, 6)  # of one camera, of three squares each
KINDS = ("radial2", "radial3", "outside")
RICHER = ("radial3", "brown")
LARGEST_RATIO = 1.3
"""Maximum rms of errors in stated standard deviations: chance alone gives 1.1 for 120 errors."""
# Residuals are weighted as in the fit: Tukey's biweight, in units of the poorer model's noise.
TUKEY_LIMIT = 7.041
ROUNDING = 1e-3  # of the cost: outliers and weights may differ slightly


@dataclass
class Tally:
    """Outcomes of one model."""

    ratios: list[float] = field(default_factory=list)  # errors of fx in stated std
    worse: int = 0
    refused: int = 0


def measure() -> list[Row]:
    """Print the results of the richer models for each kind of lens; f is 0.35-0.5 of the width."""
    tallies = {(kind, model): Tally() for kind in KINDS for model in ("radial2", *RICHER)}
    for kind in KINDS:
        for number in range(SCENES):
            _add(kind, number, tallies)
    for (kind, model), tally in tallies.items():
        print(
            f"  {kind:8} lens, {model:8} error / std of fx {_rms(tally.ratios):5.2f}, answered "
            f"{len(tally.ratios)}, refused {tally.refused}, worse than radial2 {tally.worse}"
        )
    rows = []
    for model in RICHER:
        own = [ratio for kind in KINDS[:2] for ratio in tallies[kind, model].ratios]
        ratio = _rms(own)
        name = f"{len(own)} `radial2` and `radial3` lenses, `{model}`: error / std of fx, rms"
        rows.append(Row(name, f"{ratio:.2f}", f"<= {LARGEST_RATIO}", ratio <= LARGEST_RATIO))
    answered = sum(len(tallies[kind, model].ratios) for kind in KINDS for model in RICHER)
    worse = sum(tallies[kind, model].worse for kind in KINDS for model in RICHER)
    name = f"{answered} fits of `radial3` and `brown`: cost larger than that of `radial2`"
    return [*rows, Row(name, f"{worse}", "0", worse == 0)]


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else 0.0


def _add(kind: str, number: int, tallies: dict[tuple[str, str], Tally]) -> None:
    rng = np.random.default_rng([SEED, KINDS.index(kind), number])
    camera, bend = _lens(rng, kind)
    edges = []
    noise = rng.uniform(*NOISE_RANGE)
    for image in range(PICTURES[number % len(PICTURES)]):
        scene = _scene(rng, camera)
        for sides in simulate.edge_points(scene, rng, noise=0.0, spacing=SPACING):
            seen = [_bent(points, camera, bend) for points in sides]
            noisy = [points + rng.normal(0.0, noise, points.shape) for points in seen]
            edges.append(ts.PlaneEdges.square(noisy, image=image))
    try:
        poorer = ts.calibrate_edges(edges, SIZE)
    except ts.TrisquareError:  # a weak scene, rightly refused
        return
    for model in ("radial2", *RICHER):
        tally = tallies[kind, model]
        try:
            found = poorer if model == "radial2" else ts.calibrate_edges(edges, SIZE, model=model)
        except ts.TrisquareError:
            tally.refused += 1
            continue
        tally.ratios.append((found.camera.fx - camera.fx) / found.std["fx"])
        scale = poorer.noise_scale
        tally.worse += _cost(found, scale) > _cost(poorer, scale) * (1.0 + ROUNDING)


def _cost(result: ts.Calibration, scale: float) -> float:
    sides = [own for figure in result.residuals for own in figure.distances]
    part = np.minimum(np.abs(np.concatenate(sides)) / scale / TUKEY_LIMIT, 1.0)
    return float((1.0 - (1.0 - part**2) ** 3).sum())


def _lens(rng: np.random.Generator, kind: str) -> tuple[TrueCamera, float]:
    """Draw a lens without folds, and its `bend` in `tan(bend theta) / bend`."""
    width, height = SIZE
    while True:
        fx = width * rng.uniform(0.35, 0.5)
        cx, cy = rng.normal([(width - 1) / 2, (height - 1) / 2], 0.01 * width)
        coefficients = np.zeros(5)
        if kind != "outside":
            coefficients[:2] = rng.uniform(-0.3, -0.2), rng.uniform(0.05, 0.13)
        if kind == "radial3":
            coefficients[4] = rng.uniform(-0.03, -0.005)
        camera = TrueCamera(fx, fx * rng.uniform(0.998, 1.002), cx, cy, coefficients, SIZE)
        if camera.is_monotonic():
            return camera, rng.uniform(0.5, 0.85) if kind == "outside" else 0.0


def _bent(points: Array, camera: TrueCamera, bend: float) -> Array:
    """Return a pinhole's pixels as seen by a lens between pinhole and stereographic."""
    if bend == 0.0:
        return points
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    offset = (points - centre) / focal
    ideal = np.linalg.norm(offset, axis=1, keepdims=True)
    observed = np.tan(bend * np.arctan(ideal)) / bend
    return np.asarray(offset * (observed / ideal) * focal + centre)


def _scene(rng: np.random.Generator, camera: TrueCamera) -> Scene:
    while True:
        try:
            return simulate.random_scene(rng, camera=camera)
        except ValueError:  # no three squares fit
            continue
