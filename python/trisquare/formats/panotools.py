"""The lens of the panorama programs: one focal length, a shifted centre, and a, b, c.

The radius that the photograph shows is ``R_d = R_u (a R_u^3 + b R_u^2 + c R_u + 1 - a - b - c)`` in
halves of the picture's shorter side, where ``R_u`` is a pinhole's of the focal length F (PanoTools
wiki, "Lens correction model"). It goes from ideal to observed, as `Camera`'s model does, of which
it shares the second power: k1 becomes b and back without loss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.other_lenses import ForeignLens, simplest_camera

# What polynomials' roots may have of an imaginary part by rounding.
REAL = 1e-9

# Powers of less bend nothing near the radius of 1; what numpy divides by them overflows.
SMALLEST_POWER = 1e-100

POWERS = ("c", "b", "a")
"""Coefficients of the first, second and third power of the radius that a pinhole shows."""


@dataclass(frozen=True, slots=True)
class PanoLens:
    """A lens as panorama programs write it.

    Parameters
    ----------
    focal : float
        F, pixels.
    a, b, c : float
        The polynomial of the radius.
    half : float
        Pixels of a radius of 1.
    centre : (float, float)
        Of projection and distortion, pixels, ``(0, 0)`` the centre of the top-left one.
    image_size : (int, int)
        Width and height.
    """

    focal: float
    a: float
    b: float
    c: float
    half: float
    centre: tuple[float, float]
    image_size: tuple[int, int]

    def as_seen(self, title: str) -> Lens:
        """Return it as a camera if it is one, else as a foreign lens of the title.

        Raises
        ------
        ValueError
            If the polynomial turns the picture inside out.
        """
        scale = 1.0 - self.a - self.b - self.c
        if not scale > 0:
            raise ValueError(f"a, b and c add up to {1 - scale:g}; the sum must be less than 1")
        # Of the radius as a pinhole's of the focal length in the centre would have it.
        step = self.focal / self.half
        bend = (self.c * step / scale, self.b * step**2 / scale, self.a * step**3 / scale)
        focal = self.focal * scale
        K = camera_matrix(focal, focal, *self.centre)
        if bend[0] == bend[2] == 0:
            return simplest_camera(K, {"k1": bend[1]}, self.image_size)
        return ForeignLens(title, K, self.image_size, " ".join(POWERS), bend)


@dataclass(frozen=True, slots=True)
class PanoFamily(Family):
    """All lenses of the panorama programs.

    Parameters
    ----------
    border : int
        Pixels of which the unit of length, half the shorter side, takes no account: 1 if it is
        counted from the centre of the first pixel to that of the last one.
    """

    free: tuple[str, ...] = POWERS
    square: bool = True
    border: int = 0

    def exactly(self, camera: Camera) -> PanoLens | None:
        """Return the lens that has the same k1, where that is all."""
        k1, *others = camera.distortion.tolist()
        if not self.is_of(camera) or any(others) or self.is_unlike(camera):
            return None
        try:
            return self.lens(
                (camera.fx, camera.fy), (camera.cx, camera.cy), (0.0, k1, 0.0), camera.image_size
            )
        except ValueError:
            return None  # it does not reach the radius of 1; the nearest says so

    def lens(
        self,
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        image_size: tuple[int, int],
    ) -> PanoLens:
        """Return the lens, stretched so that ``1 - a - b - c`` is what it must be.

        The ideal radius ``u`` whose observed radius is 1 is the one at which the program's
        undistorted picture meets the photograph: ``F = f / u``.
        """
        half = 0.5 * (min(image_size) - self.border)
        if half == 0:
            raise ValueError("there is no unit of length in a picture that is one pixel wide")
        powers = [value * (half / focal[0]) ** (i + 1) for i, value in enumerate(coefficients)]
        roots = _real_roots([-1.0, 1.0, *powers])
        if not np.any(roots > 0):
            raise ValueError(f"the lens never shows a radius of {half:g} px")
        u = float(roots[roots > 0].min())
        for _ in range(2):  # the roots are good to half the digits, Newton's steps to all
            value = u * (1.0 + sum(power * u ** (i + 1) for i, power in enumerate(powers))) - 1.0
            slope = 1.0 + sum((i + 2) * power * u ** (i + 1) for i, power in enumerate(powers))
            u -= value / slope
        c, b, a = (power * u ** (i + 2) for i, power in enumerate(powers))
        return PanoLens(focal[0] / u, a, b, c, half, (centre[0], centre[1]), image_size)


def _real_roots(coefficients: list[float]) -> FloatArray:
    """Return the real roots of a polynomial, the constant first."""
    last = np.flatnonzero(np.abs(coefficients) > SMALLEST_POWER)[-1]
    roots = np.polynomial.polynomial.polyroots(coefficients[: last + 1])
    return np.asarray(roots.real[np.abs(roots.imag) <= REAL * np.maximum(1.0, np.abs(roots))])
