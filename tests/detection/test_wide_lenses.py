"""Boards and tags in pictures of fisheye lenses; near the border their sides bend by a tenth."""

from __future__ import annotations

import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.detection.boards.find import find_lattices
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sheets.aprilgrids import find_aprilgrids
from trisquare.detection.square_views import SquareViews
from trisquare.measurement.find import search
from trisquare.measurement.squares import Square
from trisquare_scenes.wide import (
    wide_aprilgrid_scene,
    wide_board_scene,
    wide_charuco_scene,
    wide_tag_scene,
)


@pytest.mark.parametrize("degrees", first_quick([190.0, 150.0, 110.0]))
def test_boards_are_found_whole(degrees):
    rng = np.random.default_rng(1)
    scene = wide_board_scene(rng, simulate.fisheye(degrees))
    lattices = find_lattices(simulate.render(scene, rng))
    assert [sorted(lattice.present.shape) for lattice in lattices] == [[6, 8]] * 3
    assert all(lattice.present.all() for lattice in lattices)


@pytest.mark.parametrize(("name", "degrees"), first_quick([("4X4_50", 190.0), ("7X7_1000", 140.0)]))
def test_tags_are_read(name, degrees):
    rng = np.random.default_rng(1)
    scene, numbers = wide_tag_scene(rng, simulate.fisheye(degrees), name)
    found = search(simulate.render(scene, rng), TargetKinds.parse("auto")).found
    tags = [one.outline.tag for one in found if isinstance(one, Square)]
    assert sorted(tag.number for tag in tags if tag) == sorted(numbers)


@pytest.mark.parametrize(("across", "degrees"), first_quick([(4, 190.0), (6, 150.0)]))
def test_aprilgrids_are_found_whole_and_calibrate(across, degrees):
    rng = np.random.default_rng(3)
    scene = wide_aprilgrid_scene(rng, simulate.fisheye(degrees), (across, across))
    picture = simulate.render(scene, rng, tone="srgb")
    tags = [len(grid.tags) for grid in find_aprilgrids(picture)]
    assert len(tags) == 3
    assert sum(tags) >= 0.95 * 3 * across**2
    result = ts.calibrate(picture, model="fisheye")
    assert [(plane.kind, plane.rejection) for plane in result.planes] == [("sheet", None)] * 3
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"] < 0.01 * scene.camera.fx


@pytest.mark.parametrize("degrees", first_quick([190.0, 150.0]))
def test_a_stated_board_that_no_homography_has_is_found_as_well_as_untold(degrees):
    rng = np.random.default_rng(9)
    picture = simulate.render(wide_charuco_scene(rng, simulate.fisheye(degrees)), rng)
    told, untold = (
        sum(
            len(points)
            for figure in ts.detect(picture, targets=targets)
            for points in figure.points
        )
        for targets in ("charuco:8x8:0.75:6X6_1000", "auto")
    )
    assert told >= untold > 0
    with pytest.raises(ts.DetectionError, match="times as large"):
        ts.detect(picture, targets="charuco:8x8:0.6:6X6_1000")
    with pytest.raises(ts.DetectionError, match="are not where"):
        ts.detect(picture, targets="charuco:7x8:0.75:6X6_1000")


def test_points_of_bent_squares_are_where_the_lens_sees_them():
    rng = np.random.default_rng(4)
    # Equidistant, with the axis in the middle.
    camera = simulate.TrueFisheye(400.0, 400.0, 639.5, 479.5)
    scene = simulate.wide_scene(rng, camera)
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    along = np.linspace(0.0, 1.0, 32)[:, None]
    sides = np.stack([a + along * (b - a) for a, b in zip(unit, np.roll(unit, -1, 0), strict=True)])
    inside = np.array([[0.5, 0.5], [0.2, 0.3], [0.9, 0.1]])
    for number in range(len(scene.targets)):
        seen = scene.image_points(number, sides.reshape(-1, 2) - 0.5).reshape(1, 4, 32, 2)
        points = SquareViews.of(seen, camera.image_size).points(inside)[0]
        expected = scene.image_points(number, inside - 0.5)
        side = np.linalg.norm(np.diff(seen[0, :, ::31], axis=1), axis=-1).min()
        assert np.abs(points - expected).max() < 0.03 * side
