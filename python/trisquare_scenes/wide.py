"""Seeded scenes for a wide lens, for `trisquare.simulate.render`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trisquare._support.rotations import tilted
from trisquare.detection.tags.codes import dictionary
from trisquare.simulate import wide_scene
from trisquare.simulate.fisheye import TrueFisheye, meet, towards
from trisquare.simulate.scene import Scene, Target, rectangle
from trisquare_scenes.aprilgrids import AprilGridTarget
from trisquare_scenes.boards import with_boards
from trisquare_scenes.tagged import MarkedTarget

BESIDE = ((0.08, 0.82), (0.92, 0.82), (0.5, 0.1))
"""Places of rectangles beside the squares of `wide_scene`, over the picture's size."""

SHORTEST_SIDE = (0.6, 0.85)  # of a rectangle, over its longer one
LENGTH = 0.09  # approximate length of that one in the picture, over its width
TILT_RANGE = (15.0, 45.0)  # degrees


def scene_among_rectangles(rng: np.random.Generator, camera: TrueFisheye) -> Scene:
    """Draw the frames of `wide_scene`, and up to three rectangles where there is room."""
    scene = wide_scene(rng, camera, kind="frame")
    targets = list(scene.targets)
    for place in BESIDE:
        ray = camera.rays(np.array([place]) * camera.image_size)[0]
        turn = tilted(rng.uniform(*TILT_RANGE), *rng.uniform(0.0, 360.0, 2))
        corners = rectangle(0.5, 0.5 * rng.uniform(*SHORTEST_SIDE))
        distance = camera.fx / (LENGTH * camera.image_size[0])
        one = Target(towards(ray) @ turn, ray * distance, printed=corners)
        if not meet(camera, [*targets, one]):
            targets.append(one)
    return replace(scene, targets=tuple(targets))


def wide_board_scene(
    rng: np.random.Generator, camera: TrueFisheye, inner_corners: tuple[int, int] = (8, 6)
) -> Scene:
    """Draw chessboards in place of the squares of `wide_scene`, with as long a longer side."""
    return with_boards(wide_scene(rng, camera), inner_corners, max(inner_corners) + 1)


def wide_aprilgrid_scene(
    rng: np.random.Generator, camera: TrueFisheye, shape: tuple[int, int] = (6, 6)
) -> Scene:
    """Draw copies of one AprilGrid in place of the squares of `wide_scene`, as large as those."""
    scene = wide_scene(rng, camera)
    grid = AprilGridTarget(np.eye(3), np.array([0.0, 0.0, 1.0]), shape=shape)
    side = 2.0 * max(grid.extent)
    grids = (
        replace(grid, rotation=target.rotation, translation=side * target.translation)
        for target in scene.targets
    )
    return replace(scene, targets=tuple(grids))


def wide_charuco_scene(
    rng: np.random.Generator, camera: TrueFisheye, *, squares: int = 8, nearer: float = 1.6
) -> Scene:
    """Draw one ChArUco board of 6X6_1000, `nearer` times as large as a square of `wide_scene`."""
    scene = wide_scene(rng, camera)
    place = scene.targets[0]
    board = MarkedTarget(
        place.rotation,
        place.translation * squares / nearer,
        "chessboard",
        inner=0.75,
        inner_corners=(squares - 1, squares - 1),
        codes=dictionary("6X6_1000").codes[: squares**2 // 2],
    )
    return replace(scene, targets=(board,))


def wide_tag_scene(
    rng: np.random.Generator, camera: TrueFisheye, name: str = "6X6_250"
) -> tuple[Scene, list[int]]:
    """Draw tags of a dictionary in place of the squares of `wide_scene`, and their numbers."""
    scene = wide_scene(rng, camera)
    codes = dictionary(name).codes
    numbers: list[int] = rng.choice(len(codes), len(scene.targets), replace=False).tolist()
    tags = (
        MarkedTarget(target.rotation, target.translation, codes=codes[[number]])
        for target, number in zip(scene.targets, numbers, strict=True)
    )
    return replace(scene, targets=tuple(tags)), numbers
