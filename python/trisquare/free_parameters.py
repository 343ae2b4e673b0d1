"""How all of a camera's parameters follow the free ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare.camera import Camera, camera_parameters
from trisquare.checked import FloatArray


def free_columns(camera: Camera, parameters: Sequence[str], fixed: Sequence[str]) -> FloatArray:
    """Return the derivative of all nine parameters by the free ones, shape (9, n).

    Rows are in the order ``fx fy cx cy k1 k2 k3 p1 p2``. Where the aspect ratio is held, ``fy``
    follows ``fx``.
    """
    names = list(camera_parameters(camera))
    follows = np.zeros((len(names), len(parameters)))
    for column, name in enumerate(parameters):
        follows[names.index(name), column] = 1.0
        if name == "fx" and "aspect" in fixed:
            follows[names.index("fy"), column] = camera.fy / camera.fx
    return follows
