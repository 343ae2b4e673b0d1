"""The lens model of the panorama programs: one focal length, a shifted centre, and a, b, c.

The radius in the photograph is ``R_d = R_u (a R_u^3 + b R_u^2 + c R_u + 1 - a - b - c)`` in halves
of the picture's shorter side, where ``R_u`` is that of a pinhole of the focal length F (PanoTools
wiki, "Lens correction model"). It maps from ideal to observed, as `Camera`'s model does, and both
have the second power: k1 is converted to b and back without loss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.formats.approximation import Family, Lens
from trisquare.formats.other_lenses import ForeignLens, simplest_camera

# Maximum relative imaginary part of a polynomial's real roots, due to rounding.
REAL = 1e-9

# Coefficients below this are negligible near the radius of 1; numpy's division by them overflows.
SMALLEST_POWER = 1e-100

POWERS = ("c", "b", "a")
"""Coefficients of the first, second and third power of the pinhole's radius."""


@dataclass(frozen=True, slots=True)
class PanoLens:
    """A lens as described by panorama programs.

    Parameters
    ----------
    focal : float
        Focal length F, pixels.
    a, b, c : float
        Coefficients of the polynomial of the radius.
    half : float
        Length of a radius of 1, pixels.
    centre : (float, float)
        Centre of projection and distortion, pixels, ``(0, 0)`` the centre of the top-left one.
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
        """Return it as a camera if that is exact, else as a foreign lens with the title.

        Raises
        ------
        ValueError
            If the sum of a, b and c is not less than 1, which turns the picture inside out.
        """
        scale = 1.0 - self.a - self.b - self.c
        if not scale > 0:
            raise ValueError(f"a, b and c add up to {1 - scale:g}; the sum must be less than 1")
        # Coefficients for the radius of a pinhole that has the focal length of the centre.
        step = self.focal / self.half
        curvature = (self.c * step / scale, self.b * step**2 / scale, self.a * step**3 / scale)
        focal = self.focal * scale
        K = camera_matrix(focal, focal, *self.centre)
        if curvature[0] == curvature[2] == 0:
            return simplest_camera(K, {"k1": curvature[1]}, self.image_size)
        return ForeignLens(title, K, self.image_size, " ".join(POWERS), curvature)


@dataclass(frozen=True, slots=True)
class PanoFamily(Family):
    """All lenses of the panorama programs.

    Parameters
    ----------
    border : int
        Pixels by which the shorter side is reduced before it is halved to give the unit of length:
        1 if the side is counted from the centre of the first pixel to that of the last one.
    """

    free: tuple[str, ...] = POWERS
    square: bool = True
    border: int = 0

    def exactly(self, camera: Camera) -> PanoLens | None:
        """Return the lens with the same k1, if the camera has no other coefficient."""
        k1, *others = camera.distortion.tolist()
        if not self.is_of(camera) or any(others) or self.is_unlike(camera):
            return None
        try:
            return self.lens(
                (camera.fx, camera.fy), (camera.cx, camera.cy), (0.0, k1, 0.0), camera.image_size
            )
        except ValueError:
            return None  # it does not reach the radius of 1; the nearest lens raises this error

    def lens(
        self,
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        image_size: tuple[int, int],
    ) -> PanoLens:
        """Return the lens, scaled so that the polynomial's constant is ``1 - a - b - c``.

        At the ideal radius ``u`` whose observed radius is 1, the program's undistorted picture
        meets the photograph: ``F = f / u``.
        """
        half = 0.5 * (min(image_size) - self.border)
        if half == 0:
            raise ValueError("there is no unit of length in a picture that is one pixel wide")
        powers = [value * (half / focal[0]) ** (i + 1) for i, value in enumerate(coefficients)]
        roots = _real_roots([-1.0, 1.0, *powers])
        if not np.any(roots > 0):
            raise ValueError(f"the lens never shows a radius of {half:g} px")
        u = float(roots[roots > 0].min())
        for _ in range(2):  # the roots have half of the digits, Newton's steps yield all
            value = u * (1.0 + sum(power * u ** (i + 1) for i, power in enumerate(powers))) - 1.0
            slope = 1.0 + sum((i + 2) * power * u ** (i + 1) for i, power in enumerate(powers))
            u -= value / slope
        c, b, a = (power * u ** (i + 2) for i, power in enumerate(powers))
        return PanoLens(focal[0] / u, a, b, c, half, (centre[0], centre[1]), image_size)


def _real_roots(coefficients: list[float]) -> FloatArray:
    """Return the real roots of a polynomial, whose coefficients start with the constant."""
    last = np.flatnonzero(np.abs(coefficients) > SMALLEST_POWER)[-1]
    roots = np.polynomial.polynomial.polyroots(coefficients[: last + 1])
    return np.asarray(roots.real[np.abs(roots.imag) <= REAL * np.maximum(1.0, np.abs(roots))])
