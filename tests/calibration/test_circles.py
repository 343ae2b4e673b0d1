"""Circles: concentric ones of known and of unknown radii, and circles beside other figures."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import trisquare as ts
from trisquare.simulate import edge_points, random_scene
from trisquare_scenes.circles import CAMERA, circle_bound, circle_edges

SIZE = (1280, 960)
NOISE = 0.1
RADII = (0.5, 0.3)
SURE = 5.0


def scene_of(seed, count=3):
    rng = np.random.default_rng([151, seed])
    return random_scene(rng, count=count), rng


def edges_of(points, radii=RADII, **members):
    return [ts.PlaneEdges.circles(circles, radii, **members) for circles in points]


def camera_of(camera):
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion[:2]])


def off(result, scene):
    """Errors of the camera in their own standard deviations."""
    std = [result.std[name] for name in CAMERA]
    return (camera_of(result.camera) - camera_of(scene.camera)) / std


def test_without_noise_camera_and_poses_are_exact():
    scene, rng = scene_of(0)
    result = ts.calibrate_edges(edges_of(circle_edges(scene, rng, RADII, noise=0.0)), SIZE)
    np.testing.assert_allclose(camera_of(result.camera), camera_of(scene.camera), rtol=1e-7)
    for plane, target in zip(result.planes, scene.targets, strict=True):
        np.testing.assert_allclose(plane.translation, target.translation, rtol=1e-7)
        np.testing.assert_allclose(plane.rotation[:, 2], target.rotation[:, 2], atol=1e-7)
        centre = np.linalg.norm(plane.corners.mean(axis=0) - scene.image_points(0, [[0, 0]]))
        assert plane.kind == "circles"
        assert centre < 1000.0


@pytest.mark.parametrize("radii", [RADII, None])
def test_errors_are_near_the_bound(radii):
    ratios = []
    for seed in range(6):
        scene, rng = scene_of(seed)
        points = circle_edges(scene, rng, RADII, noise=NOISE)
        result = ts.calibrate_edges(edges_of(points, radii), SIZE)
        bound = circle_bound(scene, RADII, noise=NOISE, any_radii=radii is None)
        error = camera_of(result.camera) - camera_of(scene.camera)
        ratios.append(error / [bound[name] for name in CAMERA])
        for plane in result.planes:
            assert plane.rms == pytest.approx(NOISE, rel=0.15)
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_unknown_radii_are_estimated_with_their_stds():
    scene, rng = scene_of(1)
    points = circle_edges(scene, rng, (*RADII, 0.15))
    result = ts.calibrate_edges(edges_of(points, (2.0, None, 0.6)), SIZE)
    for plane in result.planes:
        np.testing.assert_allclose(plane.radii[[0, 2]], [2.0, 0.6])
        np.testing.assert_array_equal(plane.radii_std[[0, 2]], 0.0)
        assert 0.0 < plane.radii_std[1] < 0.01
        assert abs(plane.radii[1] - 1.2) < SURE * plane.radii_std[1]
    again = ts.Calibration.from_json(result.to_json())
    np.testing.assert_array_equal(again.planes[0].radii, result.planes[0].radii)
    known = ts.calibrate_edges(edges_of(points, (*RADII, 0.15)), SIZE)
    assert known.planes[0].radii is None


def test_residuals_are_those_of_the_samples_in_any_order():
    scene, rng = scene_of(2)
    points = circle_edges(scene, rng, RADII)
    result = ts.calibrate_edges(edges_of(points), SIZE)
    order = [[rng.permutation(len(circle)) for circle in circles] for circles in points]
    mixed = [
        [circle[own] for circle, own in zip(circles, orders, strict=True)]
        for circles, orders in zip(points, order, strict=True)
    ]
    again = ts.calibrate_edges(edges_of(mixed), SIZE)
    assert again.camera.fx == pytest.approx(result.camera.fx, rel=1e-6)
    for before, after, orders in zip(result.residuals, again.residuals, order, strict=True):
        assert len(after.distances) == len(RADII)
        for one, other, own in zip(before.distances, after.distances, orders, strict=True):
            assert len(one) == len(own)
            np.testing.assert_allclose(np.abs(other), np.abs(one)[own], atol=1e-3)


def test_parts_of_circles_are_enough():
    scene, rng = scene_of(3)
    points = circle_edges(scene, rng, RADII, extent=0.6)
    result = ts.calibrate_edges(edges_of(points), SIZE)
    assert np.abs(off(result, scene)).max() < SURE


def test_circles_beside_squares_of_other_planes():
    scene, rng = scene_of(4)
    squares = edge_points(scene, rng, noise=NOISE)
    circles = circle_edges(scene, rng, RADII)
    mixed = [ts.PlaneEdges.square(sides) for sides in squares[:2]]
    mixed.append(ts.PlaneEdges.circles(circles[2], RADII))
    result = ts.calibrate_edges(mixed, SIZE)
    assert np.abs(off(result, scene)).max() < SURE
    assert [plane.kind for plane in result.planes] == ["square", "square", "circles"]


@pytest.mark.parametrize("freedom", ["auto", "fixed"])
def test_a_circle_on_the_plane_of_a_square_adds_what_it_shows(freedom):
    scene, rng = scene_of(5)
    squares = [
        ts.PlaneEdges.square(sides, plane=number)
        for number, sides in enumerate(edge_points(scene, rng, noise=NOISE))
    ]
    centre = (0.0, 0.0) if freedom == "fixed" else (0.05, -0.1)
    circles = [
        ts.PlaneEdges.circles(own, (0.35,), plane=number, freedom=freedom)
        for number, own in enumerate(circle_edges(scene, rng, (0.35,), centre=centre))
    ]
    alone = ts.calibrate_edges(squares, SIZE)
    both = ts.calibrate_edges([*squares, *circles], SIZE)
    assert both.std["k1"] < 0.95 * alone.std["k1"]
    assert np.abs(off(both, scene)).max() < SURE


def test_circles_beside_circles_and_squares_turn_with_their_plane():
    scene, rng = scene_of(6)
    edges = edges_of(circle_edges(scene, rng, RADII))
    edges = [replace(own, plane=number) for number, own in enumerate(edges)]
    beside = circle_edges(scene, rng, (0.1,), centre=(0.3, 0.2))
    edges += [
        ts.PlaneEdges.circles(own, plane=number, freedom="similarity")
        for number, own in enumerate(beside)
    ]
    edges += [
        ts.PlaneEdges.square(sides, plane=number, freedom="similarity")
        for number, sides in enumerate(edge_points(scene, rng, noise=NOISE))
    ]
    result = ts.calibrate_edges(edges, SIZE)
    assert np.abs(off(result, scene)).max() < SURE


def test_one_circle_on_a_plane_of_its_own_is_refused():
    scene, rng = scene_of(0)
    points = circle_edges(scene, rng, (0.5,))
    with pytest.raises(
        ts.NotEnoughDataError, match="is the only figure on its plane, and a single circle"
    ):
        ts.calibrate_edges(edges_of(points, None), SIZE)


def test_circles_beside_each_other_answer():
    scene, rng = scene_of(7)
    edges = [
        ts.PlaneEdges.circles(circles, plane=plane)
        for circles_at in (
            circle_edges(scene, rng, (0.25,), centre=(-0.3, 0.0)),
            circle_edges(scene, rng, (0.2,), centre=(0.3, 0.1)),
            circle_edges(scene, rng, (0.1,), centre=(0.0, -0.4)),
        )
        for plane, circles in enumerate(circles_at)
    ]
    result = ts.calibrate_edges(edges, SIZE)
    assert np.abs(off(result, scene)).max() < SURE


def test_concentric_circles_may_be_figures_of_their_own():
    scene, rng = scene_of(8)
    together = circle_edges(scene, rng, RADII)
    apart = [
        ts.PlaneEdges.circles([circle], plane=plane)
        for number in range(len(RADII))
        for plane, circle in enumerate(circles[number] for circles in together)
    ]
    result = ts.calibrate_edges(apart, SIZE)
    same = ts.calibrate_edges(edges_of(together, None), SIZE)
    assert result.camera.fx == pytest.approx(same.camera.fx, rel=1e-4)


def test_one_plane_of_circles_leaves_the_camera_open():
    scene, rng = scene_of(0)
    points = circle_edges(scene, rng, RADII)[:1]
    with pytest.raises(ts.NotEnoughPlanesError):
        ts.calibrate_edges(edges_of(points), SIZE)


def test_the_linear_steps_alone_answer_without_distortion():
    scene, rng = scene_of(0)
    camera = replace(scene.camera, distortion=np.zeros(5))
    scene = replace(scene, camera=camera)
    points = circle_edges(scene, rng, RADII, noise=0.0)
    result = ts.calibrate_edges(edges_of(points), SIZE, method="linear", fix="distortion")
    assert result.camera.fx == pytest.approx(camera.fx, rel=1e-6)


def test_edges_go_through_json_and_pickle():
    scene, rng = scene_of(0)
    own = ts.PlaneEdges.circles(circle_edges(scene, rng, RADII)[0], plane=3)
    assert own.radii == (1.0, None)
    for again in (ts.PlaneEdges.from_json(own.to_json()), pickle.loads(pickle.dumps(own))):
        assert again.radii == own.radii
        assert again.lines.shape == (0, 3)
        np.testing.assert_array_equal(again.points[1], own.points[1])
    assert "2 circles" in repr(own)


def test_radii_in_another_order_than_the_samples_are_refused():
    scene, rng = scene_of(0)
    points = circle_edges(scene, rng, RADII)
    told = r"figure 0: circle 0 of radius 0\.3 is seen around circle 1 of radius 0\.5"
    with pytest.raises(ValueError, match=told):
        ts.calibrate_edges(edges_of(points, RADII[::-1]), SIZE)


CIRCLE = np.array([[np.cos(angle), np.sin(angle)] for angle in range(9)]) * 100 + 500


@pytest.mark.parametrize(
    ("points", "radii", "error", "words"),
    [
        ([CIRCLE], (0.0,), ValueError, "positive"),
        ([CIRCLE], (np.nan,), ValueError, "radii"),
        ([CIRCLE, CIRCLE], (1.0, 1.0), ValueError, "different"),
        ([CIRCLE, CIRCLE], (None, 1.0), ValueError, "known"),
        ([CIRCLE], (1.0, 2.0), ValueError, "2 arrays"),
        ([CIRCLE[:4]], None, ts.NotEnoughDataError, "at least 5"),
        ([], None, ValueError, "0 arrays|1 arrays"),
    ],
)
def test_circles_that_are_none_are_refused(points, radii, error, words):
    with pytest.raises(error, match=words):
        ts.PlaneEdges.circles(points, radii)


def test_circles_have_no_aspect():
    with pytest.raises(ValueError, match="aspect"):
        ts.PlaneEdges.circles([CIRCLE], freedom="aspect")


def test_what_the_core_finds_is_what_its_classes_would_accept():
    """Planes, poses and residuals from the core are not validated."""
    scene, rng = scene_of(2)
    sides = edge_points(scene, rng, noise=NOISE)
    aspect = ts.PlaneEdges.rectangle(sides[0], None)
    circles = edges_of(circle_edges(scene, rng, RADII, noise=NOISE)[1:], None)
    result = ts.calibrate_edges([aspect, *circles], SIZE, fix=("principal_point", "aspect"))
    first, second, _ = result.planes
    assert first.aspect_std > 0
    assert first.radii is None
    assert second.aspect is None
    assert np.all(second.radii_std >= 0)
    for own in (*result.planes, *(plane.uncertainty for plane in result.planes)):
        accepted = replace(own)
        for field in fields(own):
            np.testing.assert_equal(getattr(own, field.name), getattr(accepted, field.name))
    for own in result.residuals:
        accepted = replace(own)
        for array, other in zip(own.normals, accepted.normals, strict=True):
            np.testing.assert_equal(array, other)
    arrays = (first.corners, first.rotation, first.translation, second.radii, second.radii_std)
    assert not any(array.flags.writeable for array in arrays)
    assert not any(array.flags.writeable for array in result.residuals[0].distances)
    assert not first.uncertainty.by_camera.flags.writeable
