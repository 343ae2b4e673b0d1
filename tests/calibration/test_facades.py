"""Two families of parallel lines at right angles on a plane, at unknown positions."""

from dataclasses import replace

import numpy as np
import pytest

import trisquare as ts
from trisquare.simulate import cramer_rao_bound, edge_points, random_camera, random_scene
from trisquare.simulate.scene import rectangle
from trisquare_scenes.boards import with_boards

SIZE = (1280, 960)
NOISE = 0.1
HELD = ("principal_point", "aspect")
# Numbers of lines along Y and along X.
LINES = (4, 3)
ASPECT = 1.5
SURE = 5.0


def facades(seed, *, count=3, lines=LINES):
    """A scene of facades by a camera with square pixels about the image centre, and its samples."""
    rng = np.random.default_rng([151, seed])
    drawn = random_camera(rng)
    camera = replace(drawn, fy=drawn.fx, cx=0.5 * (SIZE[0] - 1), cy=0.5 * (SIZE[1] - 1))
    squares = random_scene(rng, camera=camera, count=count)
    scene = with_boards(squares, lines, max(lines) - 1)
    return scene, edge_points(scene, rng, noise=NOISE)


def edges_of(points, rows=LINES[1], **options):
    return [ts.PlaneEdges.families(lines[:rows], lines[rows:], **options) for lines in points]


@pytest.mark.parametrize("seed", range(4))
def test_a_facade_gives_camera_pose_and_the_outermost_lines_aspect(seed):
    scene, points = facades(seed)
    result = ts.calibrate_edges(edges_of(points), SIZE, fix=HELD)
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]
    for plane, target in zip(result.planes, scene.targets, strict=True):
        assert plane.kind == "facade"
        assert abs(plane.aspect - ASPECT) < SURE * plane.aspect_std
        assert 0.0 < plane.aspect_std < 0.01
        # The unit is the distance of the outermost lines along X.
        assert plane.translation * (LINES[1] - 1) == pytest.approx(target.translation, rel=0.02)
        assert plane.rotation == pytest.approx(target.rotation, abs=0.02)
        assert plane.uncertainty is not None
    again = ts.Calibration.from_json(result.to_json(edges=True))
    assert again.planes[0].aspect_std == result.planes[0].aspect_std
    assert [edges.freedom for edges in again.edges] == ["offsets"] * 3


def test_errors_are_near_the_bound():
    names, ratios = ("f", "k1", "k2"), []
    for seed in range(8):
        scene, points = facades(seed)
        result = ts.calibrate_edges(edges_of(points), SIZE, fix=HELD)
        bound = cramer_rao_bound(scene, NOISE, spacing=4.0, free=names, any_offsets=True)
        k1, k2 = result.camera.distortion[:2] - scene.camera.distortion[:2]
        errors = {"f": result.camera.fx - scene.camera.fx, "k1": k1, "k2": k2}
        ratios.append([errors[name] / bound[name] for name in names])
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_the_order_of_the_lines_is_only_that_of_the_residuals():
    _, points = facades(0)
    order = [1, 2, 0, 5, 3, 6, 4]  # 0 to 2 are along X
    first = ts.calibrate_edges(edges_of(points), SIZE, fix=HELD)
    shuffled = [[lines[i] for i in order] for lines in points]
    second = ts.calibrate_edges(edges_of(shuffled), SIZE, fix=HELD)
    assert second.camera.fx == pytest.approx(first.camera.fx, rel=1e-7)
    for one, other in zip(first.residuals, second.residuals, strict=True):
        for place, line in enumerate(order):
            assert other.distances[place] == pytest.approx(one.distances[line], abs=1e-4)


def test_two_lines_of_each_family_are_a_rectangle_of_unknown_aspect():
    _, points = facades(1, lines=(2, 2))
    by_families = ts.calibrate_edges(edges_of(points, 2), SIZE, fix=HELD)
    rectangles = [
        ts.PlaneEdges.rectangle([top, right, bottom, left], None)
        for top, bottom, left, right in points
    ]
    by_rectangles = ts.calibrate_edges(rectangles, SIZE, fix=HELD)
    assert by_families.camera.fx == pytest.approx(by_rectangles.camera.fx, rel=1e-7)
    assert by_families.std["fx"] == pytest.approx(by_rectangles.std["fx"], rel=1e-4)
    assert by_families.planes[0].aspect == pytest.approx(by_rectangles.planes[0].aspect, rel=1e-7)


def test_deviations_weigh_the_lines_they_were_given_for():
    scene, points = facades(2)
    rng = np.random.default_rng(152)
    loose = 3  # a line along Y
    edges = []
    for lines in points:
        std = [np.full(len(line), NOISE) for line in lines]
        std[loose][:] = 3.0
        lines[loose] = lines[loose] + rng.normal(0.0, std[loose][0], lines[loose].shape)
        edges += edges_of([lines], std=std)
    result = ts.calibrate_edges(edges, SIZE, fix=HELD)
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]
    assert result.std["fx"] < 0.005 * scene.camera.fx


def test_five_facades_answer_for_everything():
    scene, points = facades(1, count=5)
    result = ts.calibrate_edges(edges_of(points), SIZE)
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < SURE * result.std[name]


def test_one_facade_gives_the_focal_length():
    scene, points = facades(3, count=1)
    result = ts.calibrate_edges(edges_of(points), SIZE, fix=HELD)
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]


def test_three_facades_leave_the_camera_open():
    _, points = facades(0)
    with pytest.raises(ts.NotEnoughPlanesError, match="only a right angle is known determines one"):
        ts.calibrate_edges(edges_of(points), SIZE)


@pytest.mark.parametrize("rejected", [False, True])
def test_what_nothing_checks_is_told_the_more_where_a_facade_was_rejected(rejected):
    rng = np.random.default_rng(156)
    camera = replace(random_camera(rng), fx=900.0, fy=900.0)
    scene = random_scene(rng, camera=camera, count=4 if rejected else 3)
    if rejected:
        shear = np.array([[1.0, 0.0], [np.radians(3.0), 1.0]])
        first = replace(scene.targets[0], printed=rectangle(0.5, 0.5) @ shear)
        scene = replace(scene, targets=(first, *scene.targets[1:]))
    sides = edge_points(scene, rng, noise=NOISE)
    edges = [ts.PlaneEdges.families(own[::2], own[1::2]) for own in sides]
    result = ts.calibrate_edges(edges, SIZE, fix="aspect")
    (told,) = (warning for warning in result.warnings if warning.code == "targets_unchecked")
    assert told.severity == ("high" if rejected else "medium")
    assert (
        "and one of them may be the wrong one instead of the rejected plane" in told
    ) == rejected
    assert "right angles of the targets are off by 0.2 degrees" in told


def test_a_facade_has_its_plane_for_itself():
    _, points = facades(0)
    with pytest.raises(ValueError, match="plane of its own"):
        ts.calibrate_edges(edges_of(points, plane=7), SIZE, fix=HELD)


def test_a_family_of_one_line_is_refused():
    _, points = facades(0)
    with pytest.raises(ts.NotEnoughDataError, match="family"):
        ts.PlaneEdges.families(points[0][:3], points[0][3:4])
    with pytest.raises(ts.NotEnoughDataError, match="family"):
        ts.PlaneEdges.families([], points[0])


def test_lines_of_the_other_family_are_named():
    _, points = facades(0)
    *along_x, first, second, third, fourth = points[0]
    with pytest.raises(ValueError, match="lines 1 and 3 of figure 0 cross"):
        ts.PlaneEdges.families([*along_x, second], [first, third, fourth])


def test_lines_in_any_other_direction_are_refused():
    _, points = facades(0)
    edges = edges_of(points)
    slanted = edges[0].lines.copy()
    slanted[1] = [0.6, 0.8, 0.0]
    edges[0] = ts.PlaneEdges(slanted, edges[0].points, freedom="offsets")
    with pytest.raises(ValueError, match="neither along X nor along Y"):
        ts.calibrate_edges(edges, SIZE, fix=HELD)
