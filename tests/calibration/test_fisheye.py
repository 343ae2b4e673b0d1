"""Fisheye lenses, from edges and from pictures, and all functions for them."""

import json
import pickle

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare.simulate import (
    cramer_rao_bound,
    edge_points,
    fisheye,
    image_circle,
    render,
    wide_scene,
)
from trisquare_scenes.wide import scene_among_rectangles

SIZE = (1280, 960)
FREE = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
NOISE, SPACING = 0.1, 6.0


def camera_of(truth):
    return ts.Camera(truth.K, truth.distortion, truth.image_size, "fisheye")


def edges_of(scene, rng):
    points = edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    return [ts.PlaneEdges.square(sides) for sides in points]


def values(camera):
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


@pytest.fixture(scope="module")
def wide():
    """A scene under a lens of 190 degrees, and the calibration from its edges."""
    rng = np.random.default_rng(131)
    scene = wide_scene(rng, fisheye(190.0))
    result = ts.calibrate_edges(edges_of(scene, rng), image_size=SIZE, model="fisheye")
    return scene, result


@pytest.mark.parametrize("degrees", [100, 160, 220])
def test_errors_of_a_calibration_from_edges_are_near_the_bound(degrees):
    ratios = []
    for seed in range(6):
        rng = np.random.default_rng([132, degrees, seed])
        scene = wide_scene(rng, fisheye(degrees))
        result = ts.calibrate_edges(edges_of(scene, rng), image_size=SIZE, model="fisheye")
        bound = cramer_rao_bound(scene, NOISE, spacing=SPACING, free=FREE)
        errors = values(result.camera) - values(camera_of(scene.camera))
        ratios.append(errors / [bound[name] for name in FREE])
        assert result.parameters == FREE
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


@pytest.mark.parametrize("degrees", [100, 190])
def test_a_picture_is_found_and_answered_within_its_standard_deviations(degrees):
    rng = np.random.default_rng([133, degrees])
    scene = wide_scene(rng, fisheye(degrees))
    result = ts.calibrate(render(scene, rng), model="fisheye", tone="linear")
    assert result.stage == "pixels"
    std = np.array([result.std[name] for name in FREE])
    assert (np.abs(values(result.camera) - values(camera_of(scene.camera))) < 4.5 * std).all()


def test_squares_are_found_in_a_circle_of_light_among_clutter():
    rng = np.random.default_rng(137)
    scene = wide_scene(rng, fisheye(170.0))
    overlays = (image_circle(scene),)
    picture = render(scene, rng, tone="srgb", clutter=20, overlays=overlays)
    assert (picture[:5, :5] < 20).all()  # the corners are black
    result = ts.calibrate(picture, model="fisheye")
    assert len(result.planes) == 3
    assert abs(result.camera.fx - scene.camera.fx) < 4.5 * result.std["fx"]


@pytest.mark.slow
def test_evidence_takes_a_fisheye_for_what_it_is(wide):
    _, result = wide
    found = ts.calibrate_edges(result.edges, image_size=SIZE, model="auto")
    assert found.camera.model in ("fisheye1", "fisheye2", "fisheye")
    others = {other.model: other.log_evidence for other in found.alternatives}
    assert "equidistant" in others
    assert max(others.values()) <= 0.0
    plain = wide_scene(np.random.default_rng(135), fisheye(130.0, np.zeros(4)))
    edges = edges_of(plain, np.random.default_rng(136))
    assert ts.calibrate_edges(edges, image_size=SIZE, model="auto").camera.model == "equidistant"


@pytest.mark.parametrize("model", first_quick(["radial2", "radial1", "brown"]))
def test_under_another_model_a_warning_names_it(wide, model):
    _, result = wide
    found = ts.calibrate_edges(result.edges, image_size=SIZE, model=model)
    first = found.warnings[0]
    assert (first.code, first.severity) == ("lens_beyond_model", "high")
    assert 'model="fisheye' in first


@pytest.mark.parametrize("model", first_quick(["brown", "radial3"]))
def test_where_another_model_gives_no_answer_the_error_names_it(model):
    rng = np.random.default_rng([131, 0])
    edges = edges_of(wide_scene(rng, fisheye(120.0)), rng)
    with pytest.raises(
        ts.DegenerateGeometryError, match=r"the lens is a fisheye: choose .* fisheye"
    ):
        ts.calibrate_edges(edges, image_size=SIZE, model=model)


@pytest.mark.parametrize("model", ["equidistant", "fisheye1"])
def test_with_too_few_coefficients_the_lens_is_named(wide, model):
    scene, right = wide
    found = ts.calibrate_edges(right.edges, image_size=SIZE, model=model)
    high = [warning.code for warning in found.warnings if warning.severity == "high"]
    assert "lens_beyond_model" in high
    assert found.std["fx"] > 4 * right.std["fx"]
    assert abs(found.camera.fx - scene.camera.fx) < 4 * found.std["fx"]
    assert all("resolve the warning" in own.remedy for own in ts.diagnose(found).values())


def test_its_maps_are_those_of_opencv():
    camera = camera_of(fisheye(170.0))
    points = np.array([[0.3, 0.2, 1.0], [-2.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), camera.K, camera.distortion
    )
    assert np.abs(camera.project(points) - expected[:, 0]).max() < 1e-9
    pixels = np.array([[200.0, 300.0], [900.0, 700.0]])
    ideal = cv2.fisheye.undistortPoints(pixels[:, None], camera.K, camera.distortion, P=camera.K)
    assert np.abs(camera.undistort_points(pixels) - ideal[:, 0]).max() < 1e-3
    assert np.abs(camera.distort_points(camera.undistort_points(pixels)) - pixels).max() < 1e-9


def test_rays_behind_the_camera_have_their_pixels():
    camera = camera_of(fisheye(220.0))
    ray = np.array([[np.sin(1.9), 0.0, np.cos(1.9)]])
    pixel = camera.project(ray)
    assert np.abs(camera.unproject(pixel) - ray).max() < 1e-12
    assert camera.can_project([*ray, [0.0, 0.0, -1.0]]).tolist() == [True, False]
    with pytest.raises(ValueError, match="beyond the valid radius"):
        camera.undistort_points(pixel)


def test_its_projection_is_as_uncertain_as_its_errors(wide):
    scene, result = wide
    stated = result.projection_map(step=160.0)
    assert np.isfinite(stated.std).all()
    found = ts.compare(result, camera_of(scene.camera))
    assert found.p_value > 0.001
    assert found.unexplained < 0.5 * found.rms
    assert 0.1 < found.rms / np.sqrt(np.mean(stated.std**2)) < 3.0


def test_a_narrow_lens_may_be_compared_with_it():
    wide = camera_of(fisheye(100.0))
    narrow = ts.Camera(wide.K, np.zeros(5), wide.image_size, "none")
    assert ts.compare(wide, narrow).rms > 10.0


def test_distances_are_measured_on_its_planes(wide):
    scene, result = wide
    target = scene.targets[0]
    corners = np.array([[-0.5, -0.5], [0.5, -0.5]])
    pixels = scene.camera.project(target.to_camera(corners))
    measured = ts.measure(result.planes[0], pixels, result)
    assert abs(measured.lengths[0] - 1.0) < 5 * measured.lengths_std[0]


def test_pinhole_views_of_it_are_straight(wide):
    _, result = wide
    picture = np.zeros((960, 1280), np.uint8)
    for balance in (0.0, 1.0):
        assert ts.undistort(picture, result.camera, balance=balance).shape == picture.shape
    with pytest.raises(ValueError, match="pinhole"):
        ts.Undistorter(
            result.camera, new_camera=ts.Camera(result.camera.K, [0] * 4, SIZE, "equidistant")
        )


def test_it_goes_to_json_and_back(wide):
    _, result = wide
    again = ts.Calibration.from_json(result.to_json())
    assert again.to_json() == result.to_json()
    assert len(json.loads(result.to_json())["camera"]["distortion"]) == 4
    assert (
        values(pickle.loads(pickle.dumps(result)).camera).tolist() == values(result.camera).tolist()
    )


def test_a_known_camera_locates_squares(wide):
    scene, result = wide
    rng = np.random.default_rng(134)
    located = ts.calibrate_edges(
        edges_of(scene, rng),
        image_size=SIZE,
        model="fisheye",
        fix=("focal", "principal_point", "distortion"),
        initial=result.camera,
    )
    assert located.camera.distortion.tolist() == result.camera.distortion.tolist()
    for plane, target in zip(located.planes, scene.targets, strict=True):
        assert np.abs(plane.rotation[:, 2] - target.rotation[:, 2]).max() < 0.01


def test_the_distortion_of_another_family_cannot_be_held(wide):
    _, result = wide
    with pytest.raises(ValueError, match="cannot be fixed"):
        ts.calibrate_edges(
            result.edges, image_size=SIZE, model="radial2", fix="distortion", initial=result.camera
        )


def test_a_prediction_is_what_the_edges_then_tell(wide):
    scene, result = wide
    camera = camera_of(scene.camera)
    planned = ts.predict(camera, scene.targets, NOISE, spacing=SPACING)
    ratios = [planned.std[name] / result.std[name] for name in FREE]
    assert 0.8 < min(ratios) <= max(ratios) < 1.25
    with pytest.raises(ValueError, match="no lens model of this camera"):
        ts.predict(camera, scene.targets, NOISE, model="radial2")


@pytest.mark.parametrize("seed", first_quick([0, 4, 6, 9], 2))
def test_squares_are_told_from_rectangles_beside_them_whatever_the_lens(seed):
    rng = np.random.default_rng(seed)
    scene = scene_among_rectangles(rng, fisheye(170.0))
    result = ts.calibrate(render(scene, rng, tone="srgb"), model="auto")
    assert not [warning for warning in result.warnings if warning.severity != "low"]
    used = [plane for plane in result.planes if plane.rejection is None]
    assert len(used) == 3
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < 4.0 * result.std[name], name
