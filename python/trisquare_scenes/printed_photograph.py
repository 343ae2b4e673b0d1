"""Photographs of printed sheets, as taken by a reader of the documentation."""

from __future__ import annotations

import numpy as np

from trisquare import simulate
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene


def printed_photograph(scene: Scene, rng: np.random.Generator) -> Image:
    """Render a scene in colour among clutter, under random conditions, as decoded JPEG."""
    return simulate.render(
        scene,
        rng,
        noise=rng.uniform(1.0, 4.0),
        blur=rng.uniform(0.5, 1.2),
        contrast=rng.uniform(130.0, 200.0),
        tone="srgb",
        colour=True,
        shading=rng.uniform(0.0, 0.4),
        clutter=int(rng.integers(20, 80)),
        jpeg_quality=int(rng.integers(80, 96)),
    )
