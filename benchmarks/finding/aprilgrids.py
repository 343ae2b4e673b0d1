"""Kalibr AprilGrids without options: tags found, and error.

Pictures of three grids of 6 x 6 or 4 x 4 tags, JPEG 85. A tag is found if all its corners are
crossings of a grid. The bound is that of the pixels along the sides of the tags.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare.detection.kinds import TargetKinds
from trisquare.measurement.boards import Board
from trisquare.measurement.find import search
from trisquare.simulate.scene import Array, Scene, rectangle
from trisquare_scenes.aprilgrids import (
    AprilGridTarget,
    aprilgrid_box_scene,
    aprilgrid_poses_scene,
    photograph,
)
from trisquare_scenes.picture_bound import picture_bound

PICTURES = 40
SEED = 57
SHAPES = ((6, 6), (4, 4))
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
JPEG_QUALITY = 85
NEAR = 2.0
"""Maximum distance, in pixels, between a tag's corner and a crossing found at it."""

READ_TARGET = 0.95
BOUND_TARGET = 1.3


def measure() -> list[Row]:
    """Draw boxes with three grids, and three copies of one grid in three poses."""
    read = every = refused = 0
    ratios, normalised = [], []
    for index in range(PICTURES):
        rng = np.random.default_rng([SEED, index])
        draw = (aprilgrid_box_scene, aprilgrid_poses_scene)[index // 2 % 2]
        scene = draw(rng, SHAPES[index % 2])
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture, ideal = photograph(
            scene, rng, noise=noise, blur=blur, tone="srgb", jpeg_quality=JPEG_QUALITY, exact=True
        )
        tags = _tags(scene)
        every += len(tags)
        read += _read(picture, tags)
        bound = picture_bound(scene, ideal, picture.astype(np.float32) - ideal, blur)["fx"]
        try:
            result = ts.calibrate(picture)
        except ts.TrisquareError as error:
            print(f"  picture {index}: {error}")
            refused += 1
            continue
        error = result.camera.fx - scene.camera.fx
        ratios.append(error / bound)
        normalised.append(error / result.std["fx"])
    ratio, rms = (float(np.sqrt(np.mean(np.square(of)))) for of in (ratios, normalised))
    print(f"  abs(error) / bound, sorted: {np.round(np.sort(np.abs(ratios)), 2).tolist()}")
    print(f"  error / stated std of fx, rms: {rms:.2f}; {refused} refused")
    return [
        Row(
            f"{PICTURES} pictures: tags found",
            f"{read} of {every} ({read / every:.1%})",
            f">= {READ_TARGET:.0%}",
            read >= READ_TARGET * every,
        ),
        Row(
            f"{PICTURES} pictures: error / Cramer-Rao bound of fx",
            f"{ratio:.2f} ({refused} refused)",
            f"<= {BOUND_TARGET:.2f}",
            ratio <= BOUND_TARGET and refused == 0,
        ),
    ]


def _tags(scene: Scene) -> list[Array]:
    """Return the corners of all tags in the picture, each of shape (4, 2)."""
    return [
        scene.camera.project(target.to_camera(middle + rectangle(0.5, 0.5)))
        for target in scene.targets
        if isinstance(target, AprilGridTarget)
        for _, middle in target.tags()
    ]


def _read(picture: Array, tags: list[Array]) -> int:
    """Count the tags whose corners are all crossings of a grid that was found."""
    found = search(picture, TargetKinds.parse("auto")).targets
    boards = [one.lattice for one in found if isinstance(one, Board) and one.kind == "sheet"]
    crossings = [lattice.crossings[lattice.present] for lattice in boards]
    if not crossings:
        return 0
    points = np.concatenate(crossings)
    return sum(
        bool((np.linalg.norm(points - corners[:, None], axis=2).min(axis=1) < NEAR).all())
        for corners in tags
    )
