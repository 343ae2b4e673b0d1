"""The lens models: their names, and the coefficients of each."""

from __future__ import annotations

BROWN = ("k1", "k2", "p1", "p2", "k3")
FISHEYE = ("k1", "k2", "k3", "k4")
RATIONAL = (*BROWN, "k4", "k5", "k6")
THIN_PRISM = (*RATIONAL, "s1", "s2", "s3", "s4")

COEFFICIENTS = {
    "none": BROWN,
    "radial1": BROWN,
    "radial2": BROWN,
    "radial3": BROWN,
    "brown": BROWN,
    "equidistant": FISHEYE,
    "fisheye1": FISHEYE,
    "fisheye2": FISHEYE,
    "fisheye": FISHEYE,
    "rational": RATIONAL,
    "brown_prism": THIN_PRISM,
    "thin_prism": THIN_PRISM,
}
"""The coefficients of each model's distortion in OpenCV's order; some models hold some at zero."""

MODELS = tuple(COEFFICIENTS)


def is_fisheye(model: str) -> bool:
    """Return whether a lens of a model bends rays by their angle with the axis."""
    return COEFFICIENTS[model] == FISHEYE
