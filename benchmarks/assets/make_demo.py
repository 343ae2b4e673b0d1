"""Make the demo's photograph and its truth: ``python benchmarks/assets/make_demo.py``.

Equal seeds give equal pixels, so that running it again must not change the files.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from trisquare import Camera, simulate
from trisquare._support.json_members import dump_members
from trisquare.camera.members import camera_members
from trisquare.cli.demo import TRUTH_FORMAT

DATA = Path(__file__).parents[2] / "python" / "trisquare" / "data"

SCENE_SEED = 14
PICTURE_SEED = 14
IMAGE_SIZE = (1280, 960)
# A wide lens with a clearly visible barrel distortion: 250 px in the corners.
TRUTH = simulate.TrueCamera(
    902.4, 899.8, 651.7, 470.2, np.array([-0.286, 0.078, 0.0, 0.0, 0.0]), IMAGE_SIZE
)


def main() -> None:
    """Write ``demo.png`` and ``demo.json``."""
    scene = simulate.random_scene(np.random.default_rng(SCENE_SEED), kind="frame", camera=TRUTH)
    picture = simulate.render(
        scene,
        np.random.default_rng(PICTURE_SEED),
        noise=2.0,
        blur=0.8,
        contrast=170.0,
        tone="srgb",
        shading=0.3,
        clutter=45,
    )
    DATA.mkdir(exist_ok=True)
    cv2.imwrite(str(DATA / "demo.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    camera = Camera(TRUTH.K, TRUTH.distortion, IMAGE_SIZE)
    (DATA / "demo.json").write_text(
        dump_members(
            {
                "format": TRUTH_FORMAT,
                "image_size": list(IMAGE_SIZE),
                "camera": camera_members(camera),
            }
        ),
        "utf-8",
    )


if __name__ == "__main__":
    main()
