"""How wide a camera sees."""

from __future__ import annotations

import numpy as np

from trisquare.camera.camera import Camera


def angles_of_view(camera: Camera) -> tuple[float, float] | None:
    """Return the degrees across and down through the middle; None where the lens does not reach."""
    width, height = camera.image_size
    x, y = (width - 1) / 2.0, (height - 1) / 2.0
    ends = [[-0.5, y], [width - 0.5, y], [x, -0.5], [x, height - 0.5]]
    try:
        left, right, top, bottom = camera.unproject(ends)
    except ValueError:
        return None
    across, down = (float(np.clip(a @ b, -1.0, 1.0)) for a, b in ((left, right), (top, bottom)))
    return float(np.degrees(np.arccos(across))), float(np.degrees(np.arccos(down)))
