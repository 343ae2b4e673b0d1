"""Chessboards are found without being told of them, and nothing else is taken for one."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from trisquare import simulate
from trisquare.lattices import find_lattices

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="there is no ../shared/data")


def worst_gap(points, others):
    """Largest distance of a point to the nearest of the others, pixels."""
    return float(np.linalg.norm(points[:, None] - others, axis=2).min(axis=1).max())


@pytest.mark.parametrize("inner_corners", [(3, 3), (9, 6), (17, 12)])
def test_rendered_boards_are_found_whole(inner_corners):
    for seed in range(3):
        rng = np.random.default_rng([80, seed])
        camera = simulate.random_camera(rng)
        scene = simulate.chessboard_scene(rng, camera, inner_corners=inner_corners)
        picture = simulate.render(scene, rng, noise=6.0, contrast=60.0, shading=0.4)
        (lattice,) = find_lattices(picture)
        assert sorted(lattice.present.shape) == sorted(inner_corners)
        assert lattice.present.all()
        truth = scene.image_points(0, scene.targets[0].board_corners())
        assert worst_gap(truth, lattice.crossings.reshape(-1, 2)) < 1.0
        along = lattice.crossings[0, -1] - lattice.crossings[0, 0]
        down = lattice.crossings[-1, 0] - lattice.crossings[0, 0]
        assert along[0] * down[1] - along[1] * down[0] > 0.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 500), (40, 40), (300, 200)])
def test_pictures_without_boards(shape):
    noise = np.random.default_rng(81).integers(0, 256, shape, dtype=np.uint8)
    for picture in (noise, np.zeros_like(noise), np.full_like(noise, 255)):
        assert find_lattices(picture) == []


@needs_data
def test_boards_of_real_photographs():
    records = json.loads((DATA / "opencv-chess" / "corners_left_cornerSubPix.json").read_text())
    for record in records:
        grey = cv2.imread(str(DATA / "opencv-chess" / record["image"]), cv2.IMREAD_GRAYSCALE)
        lattice = find_lattices(grey)[0]
        assert np.count_nonzero(lattice.present) == 54
        corners = np.array(record["corners_xy"])
        assert worst_gap(corners, lattice.crossings[lattice.present]) < 1.0
