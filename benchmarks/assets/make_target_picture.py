"""Make the target's picture for the documentation.

    python benchmarks/assets/make_target_picture.py

The picture shows the corner's sheet as rendered by pdftoppm, and a rendered photograph of it,
folded.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

import trisquare as ts
from trisquare import simulate

PICTURE = Path(__file__).parents[2] / "docs" / "target.jpg"
SEED = 41
HEIGHT = 560  # pixels
DPI = 240.0
GAP, GREY = 20, 225  # pixels and grey level between the two pictures


def main() -> None:
    """Write ``docs/target.jpg``."""
    sheet = cv2.cvtColor(_sheet(), cv2.COLOR_GRAY2BGR)
    rng = np.random.default_rng(SEED)
    scene = simulate.corner_scene(rng)
    photograph = simulate.render(scene, rng, tone="srgb", colour=True, shading=0.3, clutter=40)
    shown = [
        cv2.resize(picture, (0, 0), fx=size, fy=size, interpolation=cv2.INTER_AREA)
        for picture in (sheet, photograph)
        for size in [HEIGHT / picture.shape[0]]
    ]
    gap = np.full((HEIGHT, GAP, 3), GREY, np.uint8)
    framed = cv2.copyMakeBorder(
        np.hstack([shown[0], gap, shown[1]]), *(GAP,) * 4, cv2.BORDER_CONSTANT, value=(GREY,) * 3
    )
    cv2.imwrite(str(PICTURE), framed, [cv2.IMWRITE_JPEG_QUALITY, 85])


def _sheet() -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        ts.printed_target("corner").save(Path(folder) / "target.pdf")
        options = ["-r", f"{DPI:g}", "-gray", "-singlefile"]
        subprocess.run(["pdftoppm", *options, "target.pdf", "page"], cwd=folder, check=True)
        return cv2.imread(str(Path(folder) / "page.pgm"), cv2.IMREAD_GRAYSCALE)


if __name__ == "__main__":
    main()
