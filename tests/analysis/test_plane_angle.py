"""Angles between planes: against the truth, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts

PAIRS = ((0, 1), (0, 2), (1, 2))


def true_angle(scene, one, other):
    normals = [scene.targets[plane].rotation[:, 2] for plane in (one, other)]
    return np.degrees(np.arccos(normals[0] @ normals[1]))


@pytest.fixture(scope="module")
def result():
    return ts.calibrate_edges(edges_of(squares(5), noise=0.1, seed=1), IMAGE_SIZE)


def test_exact_edges_give_the_angles_of_the_scene():
    scene = squares(5)
    found = ts.calibrate_edges(edges_of(scene), IMAGE_SIZE)
    for one, other in PAIRS:
        angle, std = ts.plane_angle(found.planes[one], found.planes[other], found)
        assert angle == pytest.approx(true_angle(scene, one, other), abs=1e-6)
        assert std < 1e-5


def test_errors_are_as_large_as_stated():
    ratios = []
    for seed in range(20):
        scene = squares(seed)
        found = ts.calibrate_edges(edges_of(scene, noise=0.2, seed=seed, spacing=8.0), IMAGE_SIZE)
        for one, other in PAIRS:
            angle, std = ts.plane_angle(found.planes[one], found.planes[other], found)
            ratios.append((angle - true_angle(scene, one, other)) / std)
    # 60 ratios, correlated in threes: 1 to within 3 standard deviations.
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.35


def test_a_camera_that_is_exact_leaves_the_poses_uncertainty(result):
    one, other = result.planes[:2]
    angle, std = ts.plane_angle(one, other, result)
    given = ts.plane_angle(one, other, result.camera)
    assert given.degrees == angle
    assert given.std < std
    swapped = ts.plane_angle(other, one, result)
    assert swapped == pytest.approx((angle, std), rel=1e-9)
    assert str(given).endswith(" degrees")


def test_results_read_from_json_have_the_same_angles(result):
    read = ts.Calibration.from_json(result.to_json())
    assert ts.plane_angle(*read.planes[:2], read) == ts.plane_angle(*result.planes[:2], result)


def test_planes_that_have_no_angle_are_refused(result):
    one, other = result.planes[:2]
    with pytest.raises(ValueError, match="different pictures, 0 and 1"):
        ts.plane_angle(one, replace(other, image=1), result)
    with pytest.raises(ValueError, match="calibrate again with this version"):
        ts.plane_angle(one, replace(other, uncertainty=None), result)
    with pytest.raises(
        TypeError, match=r"one must be a Plane, such as result.planes\[0\], not int"
    ):
        ts.plane_angle(0, other, result)
