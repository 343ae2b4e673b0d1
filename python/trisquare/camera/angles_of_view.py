"""Angles of view of a camera."""

from __future__ import annotations

import numpy as np

from trisquare.camera.camera import Camera


def angles_of_view(camera: Camera) -> tuple[float, float] | None:
    """Return the angles of view across and down, degrees; None where the lens is not valid."""
    width, height = camera.image_size
    x, y = (width - 1) / 2.0, (height - 1) / 2.0
    ends = [[-0.5, y], [width - 0.5, y], [x, -0.5], [x, height - 0.5]]
    try:
        middle, *rays = camera.unproject([[x, y], *ends])
    except ValueError:
        return None
    # Measured from the middle: two rays are never more than 180 degrees apart.
    left, right, top, bottom = np.degrees(np.arccos(np.clip(np.array(rays) @ middle, -1.0, 1.0)))
    return float(left + right), float(top + bottom)
