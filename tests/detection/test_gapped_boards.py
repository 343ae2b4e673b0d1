"""Boards whose dark cells do not touch, or overlap, are found; separate tiles are not."""

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.detection.boards.find import find_lattices
from trisquare_scenes.gapped_boards import gapped_scene


@pytest.mark.parametrize("cell", first_quick([30.0, 18.0, 50.0, 85.0]))
@pytest.mark.parametrize("gap", first_quick([2.8, -1.8, 1.5], 2))
def test_boards_with_gaps_or_overlaps_are_found_whole(gap, cell):
    rng = np.random.default_rng([85, int(cell)])
    scene = gapped_scene(rng, gap, cell=cell)
    (lattice,) = find_lattices(simulate.render(scene, rng, blur=0.7, noise=2.0))
    truth = scene.image_points(0, scene.targets[0].board_corners())
    assert np.count_nonzero(lattice.present) == len(truth)
    gaps = np.linalg.norm(truth[:, None] - lattice.crossings.reshape(-1, 2), axis=2)
    # Inside a gap of 3 pixels the grey levels are nearly flat, and only the edges give the
    # position.
    assert gaps.min(axis=1).max() < 1.5


@pytest.mark.parametrize("gap", first_quick([-0.3, 2.0, 0.3]))
def test_cells_that_do_not_touch_are_no_tone_curve_and_no_motion(gap):
    rng = np.random.default_rng([88, 1])
    camera = simulate.random_camera(rng)
    scenes = [gapped_scene(rng, gap, cell=60.0, camera=camera) for _ in range(3)]
    pictures = [simulate.render(scene, rng, blur=0.8, noise=2.0) for scene in scenes]
    result = ts.calibrate(pictures)
    assert abs(result.tone - 1.0) < 0.1
    causes = {warning.code for warning in result.warnings}
    assert not causes & {"motion_blurred", "periodic_pattern", "tone_contradicted"}
    assert abs(result.camera.fx - camera.fx) < 4.0 * result.std["fx"]


@pytest.mark.parametrize("seed", first_quick([0, 1, 2]))
def test_cells_that_do_not_touch_are_no_pattern_of_the_light(seed):
    rng = np.random.default_rng([88, seed])
    camera = simulate.random_camera(rng)
    scenes = [gapped_scene(rng, 0.3, cell=40.0, camera=camera) for _ in range(3)]
    pictures = [simulate.render(scene, rng, blur=0.8, noise=0.5, tone="srgb") for scene in scenes]
    codes = {warning.code for warning in ts.calibrate(pictures).warnings}
    assert "periodic_pattern" not in codes


def test_an_overlap_is_dark_only_once():
    scene = gapped_scene(np.random.default_rng(86), -2.0, cell=40.0)
    light = {"noise": 0.0, "blur": 0.5, "contrast": 100.0}
    picture = simulate.render(scene, np.random.default_rng(86), **light)
    assert picture.min() >= 77


@pytest.mark.parametrize("blur", first_quick([2.0, 1.4, 0.7]))
@pytest.mark.parametrize("share", first_quick([0.55, 0.4, 0.66, 0.8]))
def test_tiles_of_all_sizes_are_no_board(share, blur):
    ys, xs = np.mgrid[0:480, 0:640]
    rng = np.random.default_rng(87)
    for pitch in (12, 20, 40):
        inside = (xs % pitch < share * pitch) & (ys % pitch < share * pitch)
        for tiles, gaps in ((40.0, 200.0), (200.0, 40.0)):
            blurred = cv2.GaussianBlur(np.where(inside, tiles, gaps), (0, 0), blur)
            noisy = np.clip(np.rint(blurred + 2.0 * rng.standard_normal(blurred.shape)), 0, 255)
            assert find_lattices(noisy.astype(np.uint8)) == []
