"""Kalibr's AprilGrids: tags with borders of two cells whose corners touch dark squares."""

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sheets.aprilgrids import find_aprilgrids
from trisquare.detection.tags.touching import find_touching_tags
from trisquare.measurement.find import search
from trisquare.simulate.scene import Scene, rectangle
from trisquare_scenes.aprilgrids import (
    AprilGridTarget,
    aprilgrid_box_scene,
    aprilgrid_poses_scene,
    photograph,
)

NAME = "APRILTAG_36H11"


@pytest.fixture(scope="module")
def box():
    """A box with a grid of 4 x 4 tags on each of three faces, numbered from 0, 16 and 32."""
    rng = np.random.default_rng(31)
    scene = aprilgrid_box_scene(rng, (4, 4))
    return scene, photograph(scene, rng, noise=2.0, blur=0.8, jpeg_quality=85)[0]


@pytest.fixture(scope="module")
def poses():
    """Three copies of one grid of 6 x 6 small tags."""
    rng = np.random.default_rng(32)
    scene = aprilgrid_poses_scene(rng, (6, 6), gap=0.25)
    return scene, photograph(scene, rng, noise=2.0, blur=0.8, jpeg_quality=85)[0]


def corners_of(scene):
    """The corners of every tag of every target."""
    return [
        {
            number: scene.camera.project(target.to_camera(middle + rectangle(0.5, 0.5)))
            for number, middle in target.tags()
        }
        for target in scene.targets
    ]


@pytest.mark.slow
def test_a_slanted_blurred_grid_grows_from_the_tags_that_are_read_together():
    """The corners of its tags are up to 5 px off: one tag alone does not predict the next."""
    rng = np.random.default_rng([57, 5])
    scene = aprilgrid_box_scene(rng, (4, 4))
    picture, _ = photograph(scene, rng, noise=2.6, blur=1.0, tone="srgb", jpeg_quality=85)
    grids = find_aprilgrids(picture)
    assert [len(grid.tags) >= 12 for grid in grids] == [True, True, True]
    truth = corners_of(scene)
    for grid in grids:
        of_target = max(truth, key=lambda own: sum(tag.number in own for tag in grid.tags))
        for tag in grid.tags:
            assert np.abs(tag.corners - of_target[tag.number]).max() < 3.0


def test_photograph_shows_what_render_does():
    rng = np.random.default_rng(5)
    whole = aprilgrid_box_scene(rng, (2, 2))
    small = simulate.TrueCamera(400.0, 400.0, 159.5, 119.5, image_size=(320, 240))
    target = AprilGridTarget(
        whole.targets[0].rotation, np.array([0.0, 0.0, 4.0]), shape=(1, 1), first=7
    )
    scene = Scene(small, (target,))
    exact = simulate.render(scene, rng, noise=0.0, blur=0.7, dtype=np.float32)
    ideal = photograph(scene, rng, noise=0.0, blur=0.7)[1]
    error = 255.0 * exact - ideal
    assert np.abs(error).max() < 6.0
    assert np.abs(error.mean()) < 0.01
    assert error[exact < 0.8].std() < 1.0


@pytest.mark.parametrize("drawn", first_quick(["box", "poses"]))
def test_every_tag_is_read_where_it_is(drawn, request):
    scene, picture = request.getfixturevalue(drawn)
    grids = find_aprilgrids(picture)
    expected = corners_of(scene)
    assert [len(grid.tags) for grid in grids] == [len(tags) for tags in expected]
    for grid in grids:
        # The grid belongs to the nearest target, because the copies have the same numbers.
        off = [
            max(np.abs(tag.corners - tags.get(tag.number, 1e9)).max() for tag in grid.tags)
            for tags in expected
        ]
        assert min(off) < 1.0
        assert grid.gap == pytest.approx(scene.targets[0].gap)


@pytest.mark.slow
def test_more_small_tags_are_read_along_the_grid_than_alone():
    rng = np.random.default_rng(33)
    scene = aprilgrid_box_scene(rng, (6, 6))
    picture = photograph(scene, rng, noise=3.0, blur=0.9, jpeg_quality=85)[0]
    numbers, _ = find_touching_tags(picture, NAME)
    along = sum(len(grid.tags) for grid in find_aprilgrids(picture))
    assert 3 <= len(numbers) < 0.9 * along
    assert along >= 0.95 * 108


@pytest.mark.parametrize("drawn", first_quick(["box", "poses"]))
def test_grids_calibrate_a_camera_untold(drawn, request):
    scene, picture = request.getfixturevalue(drawn)
    result = ts.calibrate(picture, tone="linear")
    assert [plane.kind for plane in result.planes] == ["sheet"] * 3
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"]
    assert abs(result.camera.fx / scene.camera.fx - 1.0) < 0.005
    bound = simulate.cramer_rao_bound(scene, simulate.pixel_sigma(2.0, 175.0, 0.8))
    # JPEG's errors are added to the noise.
    assert result.std["fx"] < 2.5 * bound["fx"]
    assert not result.rejected


@pytest.mark.slow
def test_blur_does_not_change_the_gap_of_a_grid_of_small_slanted_tags():
    rng = np.random.default_rng([57, 24])
    scene = aprilgrid_box_scene(rng, (6, 6))
    picture, _ = photograph(scene, rng, noise=2.0, blur=1.2, tone="srgb", jpeg_quality=85)
    edges = ts.detect(picture)
    assert len(edges) == 3
    for figure in edges:
        for axis in (0, 1):
            tenths = 10.0 * figure.lines[figure.lines[:, axis] != 0.0, 2]
            off = tenths - tenths[0]
            assert np.allclose(off, np.rint(off))
    result = ts.calibrate_edges(edges, scene.camera.image_size)
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"] < 8.0


@pytest.mark.slow
def test_a_stated_layout_gives_what_none_does(box):
    _, picture = box
    untold = ts.detect(picture, tone="linear")
    for targets in ("aprilgrid:4x4:0.3", "apriltag"):
        told = ts.detect(picture, targets=targets, tone="linear")
        assert len(told) == len(untold) == 3
        for one, other in zip(told, untold, strict=True):
            assert np.allclose(one.lines, other.lines)
            assert all(
                np.array_equal(*points) for points in zip(one.points, other.points, strict=True)
            )


@pytest.mark.parametrize(
    ("targets", "why"),
    [
        ("aprilgrid:4x4:0.6", "times as large"),
        ("aprilgrid:5x4:0.3", "are not where"),
    ],
)
def test_a_wrong_layout_is_refused_and_says_why(box, targets, why):
    with pytest.raises(ts.DetectionError, match=why):
        ts.detect(box[1], targets=targets)


@pytest.mark.parametrize("turns", first_quick([1, 2]))
def test_a_grid_that_is_turned_or_partly_hidden_is_found(box, turns):
    _, picture = box
    hidden = picture.copy()
    tags = find_aprilgrids(picture)[0].tags
    inner = next(tag for tag in tags if tag.number % 16 == 5)
    cv2.fillPoly(hidden, [np.rint(inner.corners).astype(np.int32)], (230.0,))
    turned = np.ascontiguousarray(np.rot90(hidden, turns))
    found = find_aprilgrids(turned)
    assert sorted(len(grid.tags) for grid in found) == [15, 16, 16]
    assert len(search(turned, TargetKinds.parse("auto")).targets) == 3


def test_grids_side_by_side_are_not_joined_where_a_row_seems_to_go_on():
    """Tag 23, the last of its row, has tag 24 of the next grid to its right."""
    rng = np.random.default_rng([57, 6])
    scene = aprilgrid_poses_scene(rng, (6, 6))
    picture, _ = photograph(scene, rng, noise=2.0, blur=1.0, tone="srgb", jpeg_quality=85)
    grids = find_aprilgrids(picture)
    assert [len(grid.tags) for grid in grids] == [36, 36, 36]
    assert all(len({tag.number for tag in grid.tags}) == 36 for grid in grids)


def test_a_grid_that_is_numbered_from_the_top_is_one_grid_but_none_of_kalibr_s():
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    side, gap, cols, rows = 80, 24, 4, 3
    pitch = side + gap
    sheet = np.full((rows * pitch + gap + 80, cols * pitch + gap + 80), 230, np.uint8)
    for y in range(rows + 1):
        for x in range(cols + 1):
            left, top = 40 + x * pitch, 40 + y * pitch
            sheet[top : top + gap, left : left + gap] = 25
            if x < cols and y < rows:
                tag = cv2.aruco.generateImageMarker(book, y * cols + x, side, borderBits=2)
                middle = (slice(top + gap, top + pitch), slice(left + gap, left + pitch))
                sheet[middle] = np.where(tag > 127, 230, 25)
    picture = cv2.GaussianBlur(sheet, (0, 0), 0.8)
    (grid,) = find_aprilgrids(picture)
    places = {tag.number: tag.place for tag in grid.tags}
    steps = {(x - number % cols, y - number // cols) for number, (x, y) in places.items()}
    assert (len(places), len(steps)) == (cols * rows, 1)
    with pytest.raises(ts.DetectionError, match="are not where"):
        ts.detect(picture, targets="aprilgrid:4x3:0.3")


def test_lone_tags_and_pictures_of_nothing_are_no_grid():
    rng = np.random.default_rng(6)
    noise = rng.integers(0, 256, (300, 400), np.uint8)
    tag = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 3, 100, borderBits=2
    )
    lone = np.pad(tag, 100, constant_values=230)
    for picture in (noise, np.zeros((40, 40), np.uint8), np.zeros((33, 400), np.uint8), lone):
        assert find_aprilgrids(picture) == []
    assert find_touching_tags(lone, NAME)[0] == [3]


@pytest.mark.parametrize("gap", first_quick([0.2, 0.4]))
def test_a_grid_of_usual_tags_with_white_gaps_is_no_aprilgrid(gap):
    """Sampled with wider borders, some of its tags are close to AprilGrid codes as well."""
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    side, cols, rows = 96, 5, 4
    pitch = round(side * (1.0 + gap))
    sheet = np.full((rows * pitch + side, cols * pitch + side), 220, np.uint8)
    for number in range(rows * cols):
        x, y = side // 2 + number % cols * pitch, side // 2 + number // cols * pitch
        tag = cv2.aruco.generateImageMarker(book, number, side)
        sheet[y : y + side, x : x + side] = np.where(tag > 127, 220, 25)
    height, width = sheet.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = np.array([[60, 40], [820, 120], [790, 640], [100, 560]], np.float32)
    homography = cv2.getPerspectiveTransform(corners, seen)
    picture = cv2.warpPerspective(sheet, homography, (900, 680), borderValue=120)
    found = ts.detect(cv2.GaussianBlur(picture, (0, 0), 0.8))
    assert [figure.kind for figure in found] == ["tag"] * rows * cols
