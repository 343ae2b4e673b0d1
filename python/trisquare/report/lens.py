"""Description of the lens in a report: equations, valid radius, radial displacement."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera
from trisquare.camera.lens_models import COEFFICIENTS, is_fisheye

POWERS = ("\N{SUPERSCRIPT TWO}", "\N{SUPERSCRIPT FOUR}", "\N{SUPERSCRIPT SIX}")
EIGHTH = "\N{SUPERSCRIPT EIGHT}"

ADDED = {
    "p1": ("2·p1·x·y", "p1·(r² + 2·y²)"),
    "p2": ("p2·(r² + 2·x²)", "2·p2·x·y"),
    "s1": ("s1·r²", ""),
    "s2": ("s2·r⁴", ""),
    "s3": ("", "s3·r²"),
    "s4": ("", "s4·r⁴"),
}
"""Terms of the coefficients that are added to x and to y of the observed point."""

CURVE_POINTS = 200
"""Number of points of the curve of radial displacement: more than a plot's width on a phone."""


def lens_equations(camera: Camera, named: Collection[str]) -> Iterator[str]:
    """Yield the equations from a point (X, Y, Z) of the camera's frame to its pixel, in order.

    Parameters
    ----------
    camera : Camera
    named : collection of str
        The parameters in the equations; others are zero.
    """
    if is_fisheye(camera.model):
        factor = _polynomial("θ", ("k1", "k2", "k3", "k4"), named)
        yield "R = √(X² + Y²)"
        yield "θ = atan2(R, Z)"
        for axis in "xy":
            yield f"{axis}d = {'θ' if factor == '1' else f'θ·({factor})'}·{axis.upper()} / R"
    else:
        factor = _polynomial("r", ("k1", "k2", "k3"), named)
        divisor = _polynomial("r", ("k4", "k5", "k6"), named)
        yield "x = X / Z"
        yield "y = Y / Z"
        yield "r² = x² + y²"
        for which, axis in enumerate("xy"):
            radial = axis if factor == divisor == "1" else f"{axis}·({factor})"
            if divisor != "1":
                radial += f" / ({divisor})"
            more = [terms[which] for name, terms in ADDED.items() if name in named]
            yield f"{axis}d = {' + '.join([radial, *filter(None, more)])}"
    yield f"u = fx·xd + {'skew·yd + ' if 'skew' in named else ''}cx"
    yield "v = fy·yd + cy"


def _polynomial(variable: str, coefficients: Collection[str], named: Collection[str]) -> str:
    powers = zip(coefficients, (*POWERS, EIGHTH), strict=False)
    terms = (f"{name}·{variable}{power}" for name, power in powers if name in named)
    return " + ".join(["1", *terms])


def valid_radius_text(camera: Camera) -> str:
    """Return a sentence on the valid radius."""
    radius, pixels = camera.valid_radius, camera.valid_radius_px
    if radius is None or pixels is None:
        return "The distortion can be undone everywhere: the valid radius is infinite."
    angle = radius if is_fisheye(camera.model) else np.arctan(radius)
    where = "beyond the picture" if pixels > farthest_corner(camera) else "within the picture"
    return (
        f"Valid radius: the distortion can be undone up to {pixels:.0f} px from the principal "
        f"point, {np.degrees(angle):.1f} degrees from the axis, which is {where}."
    )


def farthest_corner(camera: Camera) -> float:
    """Return the distance of the picture's farthest corner from the principal point, pixels."""
    width, height = camera.image_size
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) - 0.5
    return float(np.linalg.norm(corners - camera.K[:2, 2], axis=1).max())


def radial_displacement(camera: Camera) -> tuple[FloatArray, FloatArray] | None:
    """Return the outward displacement of points by the lens, up to the picture's farthest corner.

    Returns
    -------
    tuple of ndarray, shape (N,), or None
        Distances of observed points from the principal point, pixels, and their excess over those
        of the ideal points: f times the tangent of the angle from the axis, for a fisheye f times
        the angle; f is fx. None if the lens has no radial distortion.
    """
    radial = np.array(
        [
            value if name.startswith("k") else 0.0
            for name, value in zip(COEFFICIENTS[camera.model], camera.distortion, strict=True)
        ]
    )
    if not radial.any():
        return None
    # Square pixels without skew: the displacement is that along x.
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fx, camera.cy], [0.0, 0.0, 1.0]])
    lens = replace(camera, K=K, distortion=radial)
    reach = farthest_corner(camera)
    if lens.valid_radius_px is not None:
        reach = min(reach, lens.valid_radius_px)
    observed = np.linspace(0.0, reach, CURVE_POINTS + 1)[:-1]  # without the turning point itself
    rays = lens.unproject(np.column_stack([lens.cx + observed, np.full(CURVE_POINTS, lens.cy)]))
    angles = np.arctan2(rays[:, 0], rays[:, 2])
    ideal = angles if is_fisheye(camera.model) else np.tan(angles)
    return observed, observed - camera.fx * ideal
