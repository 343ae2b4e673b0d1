"""The lens models: their names, and the coefficients of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias, get_args

from trisquare._support.suggestions import unknown

LensModel: TypeAlias = Literal[
    "none",
    "radial1",
    "radial2",
    "radial3",
    "brown",
    "equidistant",
    "fisheye1",
    "fisheye2",
    "fisheye",
    "rational",
    "brown_prism",
    "thin_prism",
]

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
"""Coefficients of each model's distortion in OpenCV's order; some models have fixed zeros."""

MODELS: tuple[LensModel, ...] = get_args(LensModel)

FREE = COEFFICIENTS | {
    "none": (),
    "radial1": ("k1",),
    "radial2": ("k1", "k2"),
    "radial3": ("k1", "k2", "k3"),
    "equidistant": (),
    "fisheye1": ("k1",),
    "fisheye2": ("k1", "k2"),
    "brown_prism": (*BROWN, "s1", "s2", "s3", "s4"),
}
"""Coefficients of each model that may differ from zero."""

OPENCV = (*THIN_PRISM, "tx", "ty")
"""All of OpenCV's coefficients of a pinhole, in its order; no model has the last two, which tilt
the sensor."""

OPENCV_LENGTHS = (4, 5, 8, 12, 14)
"""Numbers of coefficients in OpenCV's arrays."""


def checked_model(name: str) -> LensModel:
    """Return the name of a model if it is known.

    Raises
    ------
    ValueError
        If there is no model of this name.
    """
    if name not in MODELS:
        raise unknown("model", name, MODELS)
    return MODELS[MODELS.index(name)]


def is_fisheye(model: str) -> bool:
    """Return whether a model's distortion is a function of the angle from the axis."""
    return COEFFICIENTS[model] == FISHEYE


def simplest_model(
    coefficients: Mapping[str, float], models: Iterable[LensModel]
) -> LensModel | None:
    """Return the first of some models that has all non-zero coefficients, or None."""
    needed = {name for name, value in coefficients.items() if value}
    return next((model for model in models if needed.issubset(FREE[model])), None)


def opencv_distortion(
    values: Sequence[float], least: LensModel = MODELS[0]
) -> tuple[LensModel, list[float]] | None:
    """Return the simplest model that has OpenCV's coefficients of a pinhole, and its distortion.

    Parameters
    ----------
    values : sequence of float
        In OpenCV's order; missing ones are zero.
    least : str
        The simplest model to return.

    Returns
    -------
    (str, list of float) or None
        None if they tilt the sensor, which no model does.
    """
    named = dict(zip(OPENCV, values, strict=False))
    models = MODELS[MODELS.index(least) :]
    model = simplest_model(named, (each for each in models if not is_fisheye(each)))
    if model is None:
        return None
    return model, [named.get(name, 0.0) for name in COEFFICIENTS[model]]
