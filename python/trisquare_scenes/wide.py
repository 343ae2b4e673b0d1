"""Seeded scenes of boards and of tags that a wide lens sees, for `trisquare.simulate.render`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trisquare.detection.tags.codes import dictionary
from trisquare.simulate import wide_scene
from trisquare.simulate.fisheye import TrueFisheye
from trisquare.simulate.scene import Scene
from trisquare_scenes.boards import with_boards
from trisquare_scenes.tagged import MarkedTarget


def wide_board_scene(
    rng: np.random.Generator, camera: TrueFisheye, inner_corners: tuple[int, int] = (8, 6)
) -> Scene:
    """Draw chessboards where `wide_scene` has squares, the longer side as long as theirs."""
    return with_boards(wide_scene(rng, camera), inner_corners, max(inner_corners) + 1)


def wide_tag_scene(
    rng: np.random.Generator, camera: TrueFisheye, name: str = "6X6_250"
) -> tuple[Scene, list[int]]:
    """Draw tags of a dictionary where `wide_scene` has squares, and their numbers."""
    scene = wide_scene(rng, camera)
    codes = dictionary(name).codes
    numbers: list[int] = rng.choice(len(codes), len(scene.targets), replace=False).tolist()
    tags = (
        MarkedTarget(target.rotation, target.translation, codes=codes[[number]])
        for target, number in zip(scene.targets, numbers, strict=True)
    )
    return replace(scene, targets=tuple(tags)), numbers
