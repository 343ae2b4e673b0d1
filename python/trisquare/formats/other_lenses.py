"""Lenses of other programs' files that `Camera` cannot represent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.camera.camera import Camera
from trisquare.camera.lens_models import (
    BROWN,
    FISHEYE,
    MODELS,
    is_fisheye,
    opencv_distortion,
    simplest_model,
)


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLens:
    """A camera of a model that `Camera` does not have.

    Parameters
    ----------
    title : str
        Description in messages: ``"OpenCV's tilted-sensor model"``.
    K : ndarray, shape (3, 3)
        As `Camera.K`; ``(0, 0)`` is the centre of the top-left pixel.
    image_size : (int, int)
        Width and height in pixels.
    model : str
        The core's name of the distortion: ``"opencv"``, or the names of coefficients, separated by
        blanks, such as ``"k1 k2 k3 k4 p1 p2"`` or ``"c b a"``.
    coefficients : sequence of float
        Coefficients of the model, for ideal normalised points.
    """

    title: str
    K: FloatArray
    image_size: tuple[int, int]
    model: str
    coefficients: Sequence[float]

    def __post_init__(self) -> None:
        Camera(self.K, np.zeros(5), self.image_size)  # raises an error if K or the size is wrong


def simplest_camera(
    K: FloatArray,
    coefficients: Mapping[str, float],
    image_size: tuple[int, int],
) -> Camera:
    """Return a camera of the simplest model that has all non-zero coefficients.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        As `Camera.K`.
    coefficients : mapping of str to float
        Values of ``k1 k2 p1 p2 k3``; missing ones are zero.
    image_size : (int, int)
        Width and height.
    """
    lens = opencv_lens(K, [coefficients.get(name, 0.0) for name in BROWN], image_size)
    assert isinstance(lens, Camera)
    return lens


def check_opencv_matrix(K: FloatArray) -> None:
    """Check a camera matrix of OpenCV's, which has no skew.

    Raises
    ------
    ValueError
        If it is not a camera matrix, or has a skew.
    """
    Camera(K, np.zeros(5), (1, 1))
    if K[0, 1]:
        raise ValueError(f"K has a skew of {K[0, 1]:g} px, which OpenCV ignores: set K[0, 1] to 0")


def opencv_lens(
    K: FloatArray,
    coefficients: Sequence[float],
    image_size: tuple[int, int],
) -> Camera | ForeignLens:
    """Return a camera of the simplest model that has OpenCV's coefficients, given in its order.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        As `Camera.K`.
    coefficients : sequence of float
        ``(k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]])``: 0, 2, 4, 5, 8, 12 or
        14 of them.
    image_size : (int, int)
        Width and height.
    """
    values = [float(value) for value in coefficients]
    found = opencv_distortion(values)
    if found is None:
        return ForeignLens("OpenCV's tilted-sensor model", K, image_size, "opencv", values)
    model, distortion = found
    return Camera(K, np.array(distortion), image_size, model)


def fisheye_of(K: FloatArray, coefficients: Sequence[float], image_size: tuple[int, int]) -> Camera:
    """Return a camera whose observed radius is a polynomial of the angle (Kannala & Brandt).

    ``r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)``, the model of OpenCV's
    ``fisheye``, Kalibr's ``equidistant`` and COLMAP's ``OPENCV_FISHEYE``; missing coefficients are
    zero.
    """
    values = np.zeros(len(FISHEYE))
    values[: len(coefficients)] = coefficients
    named = dict(zip(FISHEYE, values.tolist(), strict=True))
    model = simplest_model(named, filter(is_fisheye, MODELS))
    assert model is not None
    return Camera(K, values, image_size, model)
