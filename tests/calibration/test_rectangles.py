"""Rectangles of a known and of an unknown aspect, from edges and from pictures."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare.detection.kinds import TargetKinds
from trisquare.simulate import (
    corner_scene,
    cramer_rao_bound,
    edge_points,
    photo_of_sheets,
    random_camera,
    random_scene,
    render,
)

A4 = 2.0**0.5
SIZE = (1280, 960)
NOISE = 0.1
HELD = ("principal_point", "aspect")
SURE = 5.0


def rectangles(seed, *, aspect=1.5, count=3):
    """A scene of rectangles by a camera with square pixels and a central principal point."""
    rng = np.random.default_rng([141, seed])
    drawn = random_camera(rng)
    camera = replace(drawn, fy=drawn.fx, cx=0.5 * (SIZE[0] - 1), cy=0.5 * (SIZE[1] - 1))
    scene = random_scene(rng, camera=camera, aspect=aspect, count=count)
    return scene, edge_points(scene, rng, noise=NOISE)


def edges_of(points, aspect):
    return [ts.PlaneEdges.rectangle(sides, aspect) for sides in points]


def test_a_known_aspect_says_as_much_as_a_square():
    ratios = []
    for seed in range(6):
        scene, points = rectangles(seed)
        result = ts.calibrate_edges(edges_of(points, 1.5), SIZE)
        bound = cramer_rao_bound(scene, NOISE, spacing=4.0)
        for name in ("fx", "fy", "cx", "cy"):
            error = getattr(result.camera, name) - getattr(scene.camera, name)
            ratios.append(error / bound[name])
        assert result.planes[0].kind == "rectangle"
        assert result.planes[0].aspect is None
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


@pytest.mark.parametrize("count", [2, 3, 4])
def test_four_rectangles_of_unknown_aspect_determine_a_camera(count):
    scene, points = rectangles(0, count=count)
    edges = edges_of(points, None)
    if count < 4:
        told = r"a plane of which only a right angle is known determines one of them\) need 4"
        with pytest.raises(ts.NotEnoughPlanesError, match=told):
            ts.calibrate_edges(edges, SIZE)
    else:
        result = ts.calibrate_edges(edges, SIZE)
        assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]


def test_the_shorter_side_is_the_unit_and_either_way_up_is_one_rectangle():
    scene, points = rectangles(0)
    upright = ts.calibrate_edges(edges_of(points, 1.5), SIZE)
    turned = ts.calibrate_edges(
        [ts.PlaneEdges.rectangle([*sides[1:], sides[0]], 1.0 / 1.5) for sides in points], SIZE
    )
    assert turned.camera.fx == pytest.approx(upright.camera.fx, rel=1e-6)
    # The targets' own unit is their shorter side, too.
    for result in (upright, turned):
        for plane, target in zip(result.planes, scene.targets, strict=True):
            distance = np.linalg.norm(target.translation)
            assert np.linalg.norm(plane.translation) == pytest.approx(distance, rel=0.02)


@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_an_unknown_aspect_is_estimated_with_its_std(seed):
    scene, points = rectangles(seed, aspect=1.3)
    result = ts.calibrate_edges(edges_of(points, None), SIZE, fix=HELD)
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]
    for plane in result.planes:
        assert abs(plane.aspect - 1.3) < SURE * plane.aspect_std
        assert 0.0 < plane.aspect_std < 0.01
    again = ts.Calibration.from_json(result.to_json())
    assert again.planes[0].aspect == result.planes[0].aspect
    assert again.planes[0].aspect_std == result.planes[0].aspect_std


def test_errors_with_unknown_aspects_are_near_the_bound():
    names, ratios = ("f", "k1", "k2"), []
    for seed in range(8):
        scene, points = rectangles(seed)
        result = ts.calibrate_edges(edges_of(points, None), SIZE, fix=HELD)
        bound = cramer_rao_bound(scene, NOISE, spacing=4.0, free=names, any_aspect=True)
        k1, k2 = result.camera.distortion[:2] - scene.camera.distortion[:2]
        errors = {"f": result.camera.fx - scene.camera.fx, "k1": k1, "k2": k2}
        ratios.append([errors[name] / bound[name] for name in names])
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_five_rectangles_of_unknown_aspect_answer_for_everything():
    scene, points = rectangles(1, count=5)
    result = ts.calibrate_edges(edges_of(points, None), SIZE)
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < SURE * result.std[name]


@pytest.mark.parametrize("seed", first_quick([1, 0, 2, 3]))
def test_rectangles_given_as_squares_are_told(seed):
    _, points = rectangles(seed, aspect=A4)
    try:
        result = ts.calibrate_edges([ts.PlaneEdges.square(sides) for sides in points], SIZE)
    except ts.TrisquareError:
        return
    assert any(warning.severity == "high" for warning in result.warnings)


def test_a_figure_of_unknown_aspect_has_its_plane_for_itself():
    _, points = rectangles(0)
    shared = [ts.PlaneEdges.rectangle(sides, None, plane=7) for sides in points]
    with pytest.raises(ValueError, match="unknown aspect"):
        ts.calibrate_edges(shared, SIZE, fix=HELD)


@pytest.mark.parametrize("aspect", [0.0, -1.0, np.nan, np.inf])
def test_an_aspect_that_is_none_is_refused(aspect):
    _, points = rectangles(0)
    with pytest.raises(ValueError, match="aspect"):
        ts.PlaneEdges.rectangle(points[0], aspect)


@pytest.mark.parametrize("dark", first_quick([True, False]))
def test_sheets_of_a4_are_found_whichever_way_up(dark):
    picture, scene, _ = photo_of_sheets(np.random.default_rng(145), dark=dark, rim=None)
    result = ts.calibrate(picture, targets="a4")
    assert [plane.kind for plane in result.planes] == ["rectangle"] * 3
    assert result.camera.fx == pytest.approx(scene.camera.fx, rel=2e-3)
    for plane in result.planes:
        long, short = np.linalg.norm(plane.corners[[1, 2]] - plane.corners[[0, 1]], axis=1)
        assert long > 0.6 * short


@pytest.mark.parametrize("kind", ["square", "frame"])
def test_sheets_taken_for_squares_lead_to_their_name(kind):
    rng = np.random.default_rng(3)
    scene = random_scene(rng, kind=kind, aspect=A4)
    (warning, *_) = ts.calibrate(render(scene, rng)).warnings
    assert warning.code == "planes_contradict"
    assert 'Sheets of paper and other rectangles have to be named: targets="a4"' in warning


def test_sheets_that_are_not_a4_lead_to_their_outlines():
    rng = np.random.default_rng(4)
    scene = random_scene(rng, aspect=A4)
    targets = tuple(
        replace(target, printed=target.printed * [1.0, stretch])
        for target, stretch in zip(scene.targets, (1.0, 1.1, 0.92), strict=True)
    )
    picture = render(replace(scene, targets=targets), rng)
    warnings = ts.calibrate(picture, targets="a4").warnings
    warning = next(one for one in warnings if one.code == "planes_contradict")
    assert "An outline may be that of a print on a sheet, or of a frame around it" in warning


@pytest.mark.parametrize("seed", first_quick([0, 2, 10]))
def test_bare_sheets_right_on_the_clutter_are_found_and_measured(seed):
    picture, scene, _ = photo_of_sheets(np.random.default_rng([73, seed]))
    result = ts.calibrate(picture, targets="a4")
    assert len(result.planes) == 3
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]
    assert result.std["fx"] < 1e-3 * scene.camera.fx


@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_two_rectangles_of_other_shapes_are_left_out(seed):
    rng = np.random.default_rng([146, seed])
    scene = random_scene(rng, count=5, aspect=A4)
    targets = list(scene.targets)
    for index, stretch in ((0, 0.8), (3, 1.2)):
        corners = targets[index].outlines()[0] * [1.0, stretch]
        targets[index] = replace(targets[index], printed=corners)
    picture = render(replace(scene, targets=tuple(targets)), rng, noise=2.0, blur=0.8, tone="srgb")
    result = ts.calibrate(picture, targets="a4")
    assert sum(plane.is_used for plane in result.planes) == 3
    assert abs(result.camera.fx / scene.camera.fx - 1.0) < 1e-3
    assert not [warning for warning in result.warnings if warning.severity == "high"]


def test_three_faces_at_the_corner_of_a_box_calibrate_without_their_aspects():
    rng = np.random.default_rng(149)
    camera = random_camera(rng)
    camera = replace(camera, fy=camera.fx)
    scene = corner_scene(rng, camera=camera)
    targets = tuple(replace(target, kind="square") for target in scene.targets)
    points = edge_points(replace(scene, targets=targets), rng, noise=0.1, spacing=4.0)
    edges = [ts.PlaneEdges.rectangle(sides, None) for sides in points]
    result = ts.calibrate_edges(edges, camera.image_size, fix="aspect")
    for name in ("fx", "cx", "cy"):
        assert abs(getattr(result.camera, name) - getattr(camera, name)) < SURE * result.std[name]
    assert result.std["fx"] < 2e-3 * camera.fx
    for plane in result.planes:
        assert abs(plane.aspect - 1.0) < SURE * plane.aspect_std
    # The residuals test neither the right angles of the faces nor those between them.
    for related in ([], [(0, 1), (0, 2), (1, 2)]):
        own = ts.calibrate_edges(edges, camera.image_size, fix="aspect", orthogonal=related)
        (told,) = (warning for warning in own.warnings if warning.code == "targets_unchecked")
        assert "right angles of the targets are off by 0.2 degrees" in told.text


def test_sheets_of_any_aspect_are_found_with_their_aspects():
    rng = np.random.default_rng(146)
    camera = replace(random_camera(rng), fx=1100.0, fy=1100.0, cx=639.5, cy=479.5)
    picture, _, _ = photo_of_sheets(rng, 1.6, rim=None, camera=camera)
    result = ts.calibrate(picture, targets="rectangle", fix=HELD)
    aspects = [plane.aspect for plane in result.planes]
    assert aspects == pytest.approx([1.6] * 3, abs=0.005)


@pytest.mark.parametrize(
    ("text", "aspect"),
    [
        ("a4", A4),
        ("letter", 11.0 / 8.5),
        ("card", 85.60 / 53.98),
        ("16:9", 16.0 / 9.0),
        ("rectangle:0.5", 2.0),
        ("rectangle:3:2", 1.5),
        ("rectangle:1", 1.0),
        ("rectangle", None),
    ],
)
def test_shapes_have_names(text, aspect):
    assert TargetKinds.parse(text).rectangles.aspect == aspect


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rectangle:", "must be a number"),
        ("rectangle:nan", "must be a number"),
        ("rectangle:0", "must be a number"),
        ("rectangle:1.1", "the orientation of a rectangle cannot be seen"),
        ("rectangle:30", "at most"),
        ("a5", "a4"),
    ],
)
def test_shapes_that_are_none_are_refused(text, words):
    with pytest.raises(ValueError, match=words):
        TargetKinds.parse(text)


def test_a_picture_without_rectangles_says_what_was_looked_for():
    with pytest.raises(ts.DetectionError, match="no rectangle of that shape"):
        ts.calibrate(np.full((480, 640), 128, np.uint8), targets="a4")


def test_of_a_sheared_picture_the_advice_is_not_about_paper():
    """As with a rolling shutter: another warning names it."""
    rng = np.random.default_rng(0)
    picture = render(random_scene(rng), rng, tone="srgb", noise=2.0)
    shear = np.array([[1.0, 2.0 / 960.0, 0.0], [0.0, 1.0, 0.0]])
    sheared = cv2.warpAffine(picture, shear, (1280, 960), flags=cv2.INTER_LANCZOS4)
    warnings = {own.code: own for own in ts.calibrate(sheared).warnings}
    assert "rolling shutter" in warnings["pixels_not_square"]
    assert "a4" not in warnings["planes_contradict"]
