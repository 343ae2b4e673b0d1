"""Edge points whose errors are not what a calibration would like: drawn side by side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from harness.truth import Array

import trisquare as ts
from trisquare.simulate.scene import Scene, SideSamples, sample_sides

ORDERS = np.arange(6)
"""Legendre polynomials that a smooth displacement is made of."""

CORRELATION = 0.3
"""Of neighbouring samples."""

ROUGHNESS = 5.0
"""Noise of a rough plane over that of the others."""

Errors = Callable[[np.random.Generator, int, SideSamples], Array]
"""Draws how far each sample of a side of a plane is off along its normal, in units of the noise."""


def white(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors."""
    return rng.standard_normal(len(side.image))


def displaced(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors and a smooth displacement of the side as large as they are.

    Its spectrum falls more steeply than the one that the estimate takes for granted.
    """
    deviations = np.sqrt(2.0 * ORDERS + 1.0) / (1.0 + (ORDERS / 2.0) ** 2) ** 0.75
    shapes = np.polynomial.legendre.legvander(_places(side), ORDERS[-1])
    smooth = shapes @ (deviations * rng.standard_normal(len(ORDERS)))
    return np.asarray(white(rng, plane, side) + smooth)


def bowed(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors and a parabola as high as they are, as curled paper shows it."""
    bow = rng.standard_normal() * (1.0 - _places(side) ** 2)
    return np.asarray(white(rng, plane, side) + bow)


def correlated(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw errors of which neighbours share a part: a first-order autoregression."""
    error = white(rng, plane, side)
    for i in range(1, len(error)):
        error[i] = CORRELATION * error[i - 1] + np.sqrt(1.0 - CORRELATION**2) * error[i]
    return error


def rough(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors, larger on plane 0."""
    return (ROUGHNESS if plane == 0 else 1.0) * white(rng, plane, side)


def disturbed_edges(
    scene: Scene, rng: np.random.Generator, errors: Errors, noise: float, spacing: float
) -> list[ts.PlaneEdges]:
    """Sample the sides of a scene of squares, `spacing` pixels apart, with errors of that noise."""
    edges = []
    for plane, target in enumerate(scene.targets):
        sides = sample_sides(scene.camera, target, spacing)
        off = [noise * errors(rng, plane, side) for side in sides]
        points = [
            side.image + own[:, None] * side.normal for side, own in zip(sides, off, strict=True)
        ]
        edges.append(ts.PlaneEdges.square(points))
    return edges


def _places(side: SideSamples) -> Array:
    """Place of each sample along its side, -1 to 1."""
    count = len(side.image)
    return np.asarray((2.0 * np.arange(count) + 1.0) / count - 1.0)
