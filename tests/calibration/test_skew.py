"""Cameras whose columns are not at right angles to their rows, and all functions for them."""

import json
import pickle
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import IMAGE_SIZE, camera_of, edges_of, errors_in_std, squares
from typer.testing import CliRunner

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.plan import onto_plane
from trisquare.cli.app import app
from trisquare.simulate.fisheye import fisheye, wide_scene
from trisquare.simulate.scenes import random_camera

SKEW, NOISE = 3.0, 0.1
K = [[1000.0, SKEW, 640.0], [0.0, 1003.0, 470.0], [0.0, 0.0, 1.0]]
CAMERAS = {
    "brown": ts.Camera(K, [-0.2, 0.05, 1e-3, -2e-3, 0.01], IMAGE_SIZE, "brown"),
    "rational": ts.Camera(
        K, [0.1, 0.02, 1e-3, -1e-3, 0.01, 0.3, 0.05, -0.01], IMAGE_SIZE, "rational"
    ),
    "thin_prism": ts.Camera(
        K, [0.1, 0.02, 0, 0, 0, 0.3, 0, 0, 2e-3, 0, 3e-3, 0], IMAGE_SIZE, "thin_prism"
    ),
    "fisheye": ts.Camera(K, [0.03, -0.01, 0, 0], IMAGE_SIZE, "fisheye"),
}


def skewed(seed):
    camera = replace(random_camera(np.random.default_rng(seed)), skew=SKEW)
    return squares(seed, camera=camera)


def calibrated(scene, seed=0, **options):
    return ts.calibrate_edges(edges_of(scene, NOISE, seed), IMAGE_SIZE, **options)


@pytest.fixture(scope="module")
def scene():
    return skewed(3)


@pytest.fixture(scope="module")
def result(scene):
    return calibrated(scene, free="skew")


def test_a_freed_skew_scatters_as_its_covariance_says():
    errors = []
    for seed in range(30):
        scene = skewed(seed)
        found = calibrated(scene, seed, free="skew")
        assert found.parameters == ("fx", "fy", "cx", "cy", "k1", "k2", "skew")
        errors.append(errors_in_std(found, scene))
    assert all(abs(error) < 4 for own in errors for error in own.values())
    # The standard deviation of an rms of 30 is 0.13; that of all seven together, which are
    # correlated, about 0.06.
    rms = np.sqrt(np.mean([np.square(list(own.values())) for own in errors]))
    assert 0.8 < rms < 1.2
    skews = np.sqrt(np.mean([own["skew"] ** 2 for own in errors]))
    assert 1 - 4 * 0.13 < skews < 1 + 4 * 0.13


def test_a_held_skew_that_the_planes_ask_for_is_named():
    named = []
    for seed in range(20):
        for told, scene in ((True, skewed(seed)), (False, squares(seed))):
            found = ts.calibrate_edges(edges_of(scene, 0.03, seed), IMAGE_SIZE)
            texts = [each for each in found.warnings if "K[0, 1]" in each]
            assert told or not texts
            if texts:
                (text,) = texts
                assert (text.code, text.severity) == ("pixels_not_square", "high")
                numbers = re.match(
                    r"the skew, K\[0, 1\], is fixed at 0, but with a skew of ([\d.]+) "
                    r"\+- ([\d.]+) px .* fx is ([\d.]+) px",
                    text,
                )
                skew, std, fx = map(float, numbers.groups())
                assert abs(skew - SKEW) < 4 * std + 0.1
                freed = ts.calibrate_edges(edges_of(scene, 0.03, seed), IMAGE_SIZE, free="skew")
                assert fx == pytest.approx(freed.camera.fx, abs=0.1)
                named.append(seed)
    assert len(named) > 14


@pytest.mark.parametrize("options", [{"free": "skew"}, {"fix": "principal_point"}])
def test_a_skew_that_is_free_or_held_beside_others_is_not_asked_for(options):
    for seed in range(3):
        found = ts.calibrate_edges(edges_of(skewed(seed), 0.03, seed), IMAGE_SIZE, **options)
        assert not any("K[0, 1]" in each for each in found.warnings)


def test_its_std_is_the_bound(scene, result):
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "skew")
    bound = simulate.cramer_rao_bound(scene, NOISE, spacing=4.0, free=names)
    assert result.std["skew"] == pytest.approx(bound["skew"], rel=0.15)
    planned = ts.predict(camera_of(scene), scene.targets, NOISE, spacing=4.0, model="radial2")
    freed = ts.predict(
        camera_of(scene), scene.targets, NOISE, spacing=4.0, model="radial2", free="skew"
    )
    assert "skew" not in planned.std
    assert freed.std["skew"] == pytest.approx(bound["skew"], rel=0.02)
    assert "skew" in str(freed)
    assert "skew" in str(ts.diagnose(result))


def test_held_at_zero_it_is_missed_and_held_at_its_value_it_is_right(scene, result):
    held = calibrated(scene)
    assert held.camera.skew == 0
    assert "skew" not in held.std
    assert held.rms > 1.03 * result.rms
    assert "planes_contradict" in [warning.code for warning in held.warnings]
    known = calibrated(scene, initial=camera_of(scene))
    assert known.camera.skew == SKEW
    assert "skew" not in known.std
    assert not known.warnings
    assert all(abs(error) < 4 for error in errors_in_std(known, scene).values())


def test_a_fisheye_s_is_found():
    rng = np.random.default_rng(1)
    lens = replace(fisheye(140.0, np.array([0.02, -0.01, 0.0, 0.0])), skew=SKEW)
    scene = wide_scene(rng, lens)
    edges = edges_of(scene, NOISE)
    found = ts.calibrate_edges(edges, lens.image_size, model="fisheye2", free=("skew",))
    assert found.camera.skew == pytest.approx(SKEW, abs=4 * found.std["skew"])
    assert found.std["skew"] < 1


def test_models_are_chosen_with_it_free(scene):
    found = calibrated(scene, model="auto", free="skew")
    assert found.camera.skew == pytest.approx(SKEW, abs=4 * found.std["skew"])


def test_a_photograph_s_is_found(scene):
    picture = simulate.render(scene, np.random.default_rng(0))
    found = ts.calibrate(picture, free="skew")
    assert found.stage == "pixels"
    assert found.camera.skew == pytest.approx(SKEW, abs=4 * found.std["skew"])
    places = ts.locate(picture, found)
    assert len(places) == 3
    sides = [ts.measure(place, place.corners[:2], found) for place in places]
    assert all(abs(own.lengths[0] - 1) < 4 * own.lengths_std[0] for own in sides)


def test_too_few_planes_and_bad_options_are_refused(scene):
    edges = edges_of(scene, NOISE)
    with pytest.raises(ts.NotEnoughPlanesError, match="skew"):
        ts.calibrate_edges(edges[:2], IMAGE_SIZE, free="skew")
    for options, message in (
        ({"free": "skw"}, "did you mean 'skew'"),
        ({"free": "k3"}, "model= states which ones the lens has; choose skew"),
        ({"fix": "k3"}, "single coefficients cannot be fixed"),
        ({"fix": "fx"}, "'focal' fixes fx; choose among aspect"),
        ({"fix": "cy"}, "'principal_point' fixes cy"),
        ({"free": "aspect"}, "free unless fix= names it"),
        ({"fix": "skew"}, "fixed unless free= names it"),
        ({"free": "skew", "method": "linear"}, "linear steps assume that it is zero"),
    ):
        with pytest.raises(ValueError, match=message):
            ts.calibrate_edges(edges, IMAGE_SIZE, **options)


@pytest.mark.parametrize("model", CAMERAS)
def test_every_map_of_a_camera_knows_it(model, tmp_path):
    camera = CAMERAS[model]
    plain = camera.rescaled(camera.image_size)
    straight = ts.Camera(np.eye(3), camera.distortion, IMAGE_SIZE, model)
    points = np.random.default_rng(0).uniform([-0.4, -0.3, 1.0], [0.4, 0.3, 1.0], (20, 3))
    pixels = np.column_stack([straight.project(points), np.ones(20)]) @ camera.K[:2].T
    np.testing.assert_allclose(plain.project(points), pixels, atol=1e-9)
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], points[:, :2], atol=1e-9)
    ideal = points @ camera.K[:2].T
    np.testing.assert_allclose(camera.undistort_points(pixels), ideal, atol=1e-8)
    np.testing.assert_allclose(camera.distort_points(ideal), pixels, atol=1e-8)
    half = camera.rescaled((640, 480))
    np.testing.assert_allclose(half.project(points), (pixels + 0.5) / 2 - 0.5, atol=1e-9)
    # Undistorted pictures have no skew.
    view = ts.Undistorter(camera)
    assert view.new_camera.skew == 0
    assert view.valid_mask.all()
    with pytest.raises(ValueError, match="it has a skew"):
        ts.Undistorter(camera, new_camera=ts.Camera(K, np.zeros(5), IMAGE_SIZE))
    # Its own format stores the skew; other formats refuse it by name.
    camera.save(tmp_path / "camera.json")
    again = [ts.Camera.load(tmp_path / "camera.json"), pickle.loads(pickle.dumps(camera))]
    assert all((one.K == camera.K).all() and one.skew == SKEW for one in again)
    assert "skew 3" in repr(camera)
    for name in ("a.yaml", "camera_info.yaml", "camchain.yaml", "cameras.txt", "a.cameramodel"):
        with pytest.raises(ValueError, match="skew 3 px"):
            camera.save(tmp_path / name)
        assert not (tmp_path / name).exists()


def test_a_camera_without_skew_is_written_as_ever(tmp_path):
    camera = ts.Camera(np.diag([900.0, 900.0, 1.0]), np.zeros(5), IMAGE_SIZE)
    camera.save(tmp_path / "camera.json")
    assert "skew" not in (tmp_path / "camera.json").read_text()
    camera.save(tmp_path / "camera.yaml")
    text = (tmp_path / "camera.yaml").read_text()
    with_skew = tmp_path / "skew.yaml"
    with_skew.write_text(text.replace("900.0, 0.0,", "900.0, 3.0,", 1))
    with pytest.raises(ValueError, match="OpenCV ignores"):
        ts.Camera.load(with_skew)


def test_a_result_reads_back_and_its_planes_are_measured(scene, result):
    again = ts.Calibration.from_json(result.to_json())
    assert again.to_json() == result.to_json()
    assert again.camera.skew == result.camera.skew
    assert again.std["skew"] == result.std["skew"]
    by_camera = again.planes[0].uncertainty.by_camera
    assert by_camera.shape == (6, 10)
    assert by_camera[:, 9].any()
    held = calibrated(scene)
    members = json.loads(held.to_json())
    del members["warnings"]  # one asks whether there is a skew
    assert "skew" not in json.dumps(members)
    for one in (again, held):
        plane = one.planes[0]
        corners = plane.corners[[0, 1]]
        length = np.linalg.norm(np.diff(onto_plane(corners, one.camera, plane), axis=0))
        assert ts.measure(plane, corners, one).lengths[0] == pytest.approx(length)
    assert ts.compare(again, result).rms == pytest.approx(0.0, abs=1e-9)
    assert ts.compare(again, held).rms == pytest.approx(ts.compare(result, held).rms)
    places = [[100.0, 100.0]]
    assert again.projection_std(places) == pytest.approx(result.projection_std(places))
    assert again.projection_std(places) != pytest.approx(held.projection_std(places))


def test_the_command_frees_it(scene, tmp_path):
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), simulate.render(scene, np.random.default_rng(0)))
    found = CliRunner().invoke(app, ["calibrate", str(photo), "--free", "skew", "--json"])
    assert found.exit_code == 0, found.output
    members = json.loads(found.stdout)
    assert members["camera"]["skew"] == pytest.approx(SKEW, abs=4 * members["std"]["skew"])
