"""Lenses outside the families of `simulate`: rational, thin prism."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trisquare.simulate.scene import Array, TrueCamera

_STEP = 1e-6
"""Step of the central differences: their error is some 1e-10 of a normalised coordinate."""


@dataclass(frozen=True, slots=True, eq=False)
class OtherCamera(TrueCamera):
    """A camera whose distortion is differentiated numerically."""

    def _distortion_jacobian(self, ideal: Array) -> tuple[Array, Array, Array]:
        steps = _STEP * np.eye(2)
        along_x, along_y = (
            (self.distort(ideal + step) - self.distort(ideal - step)) / (2.0 * _STEP)
            for step in steps
        )
        # Newton's method needs few digits of this, and the lenses here are nearly symmetric.
        mixed = 0.5 * (along_x[..., 1] + along_y[..., 0])
        return along_x[..., 0], mixed, along_y[..., 1]


@dataclass(frozen=True, slots=True, eq=False)
class RationalCamera(OtherCamera):
    """Radial factor ``(1 + above r^2) / (1 + below r^2)``: OpenCV's rational model, in part."""

    above: float = 0.0
    below: float = 0.0

    def distort(self, normalised: Array) -> Array:
        """Map ideal to observed normalised coordinates, shape (N, 2)."""
        square = np.sum(normalised**2, axis=-1, keepdims=True)
        distorted: Array = normalised * (1.0 + self.above * square) / (1.0 + self.below * square)
        return distorted


@dataclass(frozen=True, slots=True, eq=False)
class PrismCamera(OtherCamera):
    """Brown's distortion and OpenCV's thin prism terms ``s1, s2, s3, s4``."""

    prism: Array = field(default_factory=lambda: np.zeros(4))

    def distort(self, normalised: Array) -> Array:
        """Map ideal to observed normalised coordinates, shape (N, 2)."""
        square = np.sum(normalised**2, axis=-1, keepdims=True)
        first, second = self.prism[[0, 2]], self.prism[[1, 3]]
        distorted: Array = TrueCamera.distort(self, normalised) + square * (first + second * square)
        return distorted
