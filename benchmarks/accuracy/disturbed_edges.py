"""Edge points whose errors violate the assumptions of a calibration, drawn one side at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from harness.truth import Array

import trisquare as ts
from trisquare.simulate.scene import Scene, SideSamples, sample_sides

ORDERS = np.arange(6)
"""Orders of the Legendre polynomials of a smooth displacement."""

CORRELATION = 0.3
"""Correlation of neighbouring samples."""

ROUGHNESS = 5.0
"""Ratio of the noise of a rough plane to that of the others."""

Errors = Callable[[np.random.Generator, int, SideSamples], Array]
"""Function that draws the displacement of each sample of a plane's side along its normal, in units
of the noise."""


def white(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors."""
    return rng.standard_normal(len(side.image))


def displaced(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors and a smooth displacement of the side of the same size.

    Its spectrum falls more steeply than the estimate assumes.
    """
    deviations = np.sqrt(2.0 * ORDERS + 1.0) / (1.0 + (ORDERS / 2.0) ** 2) ** 0.75
    shapes = np.polynomial.legendre.legvander(_places(side), ORDERS[-1])
    smooth = shapes @ (deviations * rng.standard_normal(len(ORDERS)))
    return np.asarray(white(rng, plane, side) + smooth)


def bowed(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw independent errors and a parabola of the same height, as curled paper causes."""
    bow = rng.standard_normal() * (1.0 - _places(side) ** 2)
    return np.asarray(white(rng, plane, side) + bow)


def correlated(rng: np.random.Generator, plane: int, side: SideSamples) -> Array:
    """Draw errors with correlated neighbours: a first-order autoregression."""
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
    """Sample the sides of a scene's squares every `spacing` pixels, with errors of size `noise`."""
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
    """Return the position of each sample along its side, -1 to 1."""
    count = len(side.image)
    return np.asarray((2.0 * np.arange(count) + 1.0) / count - 1.0)
