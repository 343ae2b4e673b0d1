"""`straighten`: the remaining errors for a known lens, and its refusals."""

import json
import pickle
import re

import cv2
import numpy as np
import pytest
from plumb_scenes import arches, circles, plumb_scene, quads, room, small_windows, spokes, windows
from quick import first_quick

import trisquare as ts
from trisquare.images.encoding import encode_image
from trisquare.images.orientation import find_orientation, with_orientation

SIZE = (960, 720)
COEFFICIENTS = (-0.28, -0.15, -0.05, 0.0, 0.08)
MEAN, WORST = 0.5, 2.5  # pixels
NOISE = np.random.default_rng(1).integers(0, 256, SIZE[::-1], np.uint8)


def errors(found, scene):
    """Distances of the estimated displacements from the true ones, and errors in std."""
    displaced = found.camera.displacement_map(30)
    off = displaced.displacement - (displaced.points - scene.ideal(displaced.points))
    return np.linalg.norm(off, axis=1), off / np.maximum(displaced.std, 1e-12)


@pytest.fixture(scope="module")
def scene():
    return plumb_scene(np.random.default_rng(3), SIZE, -0.15)


@pytest.fixture(scope="module")
def found(scene):
    return ts.straighten(scene.picture)


@pytest.mark.parametrize("draw", first_quick([windows, quads]))
@pytest.mark.parametrize("count", first_quick([1, len(COEFFICIENTS)]))
def test_known_lenses_are_undone(draw, count):
    good = 0
    for number, k1 in enumerate(COEFFICIENTS[:count]):
        scene = plumb_scene(np.random.default_rng(70 + number), SIZE, k1, draw)
        off, in_std = errors(ts.straighten(scene.picture), scene)
        good += off.mean() <= MEAN and off.max() <= WORST
        assert np.quantile(np.abs(in_std), 0.95) < 4
    assert good >= max(count - 1, 1)


def test_a_few_straight_edges_weigh_more_than_a_floor_of_wood():
    scene = plumb_scene(np.random.default_rng(12), SIZE, -0.2, room, centre=(490.0, 352.0))
    found = ts.straighten(scene.picture)
    off, _ = errors(found, scene)
    lengths = [np.ptp(line, axis=0).max() for line in found.used + found.rejected]
    assert np.sum(np.array(lengths) > 50) > 100
    assert off.mean() <= MEAN
    assert off.max() <= WORST


def test_short_edges_in_a_row_are_one_long_line():
    scene = plumb_scene(np.random.default_rng(8), SIZE, -0.15, small_windows)
    off, _ = errors(ts.straighten(scene.picture), scene)
    assert off.mean() <= MEAN
    assert off.max() <= WORST


@pytest.mark.parametrize("k3", [0.0, -0.09])
def test_a_third_coefficient_is_free_where_the_lines_tell_it(k3):
    rng = np.random.default_rng(2)
    scene = plumb_scene(rng, SIZE, -0.45, quads, k2=0.2, k3=k3)
    found = ts.straighten(scene.picture)
    off, in_std = errors(found, scene)
    assert (found.camera.coefficients[2] == 0) == (k3 == 0)
    assert found.camera.std["a3"] > 0
    assert off.mean() <= MEAN
    assert np.abs(in_std).max() < 4


def test_the_centre_is_found_where_the_lens_is_strong():
    centre = np.array([505.0, 340.0])
    scene = plumb_scene(np.random.default_rng(4), SIZE, -0.25, centre=centre)
    camera = ts.straighten(scene.picture).camera
    std = np.array([camera.std["cx"], camera.std["cy"]])
    assert (np.abs(camera.centre - centre) < np.minimum(4 * std, 10)).all()


def test_the_centre_is_held_where_nothing_tells_it():
    scene = plumb_scene(np.random.default_rng(5), SIZE, 0.0)
    found = ts.straighten(scene.picture)
    assert found.centre_held
    np.testing.assert_allclose(found.camera.centre, (np.array(SIZE) - 1) / 2, atol=0.01)
    assert min(found.camera.std["cx"], found.camera.std["cy"]) > 10


def test_used_lines_are_straight_and_rejected_ones_are_not(scene, found):
    def deviation(line):
        ideal = scene.ideal(line)
        return np.linalg.svd(ideal - ideal.mean(axis=0))[1][1] / np.sqrt(len(ideal))

    assert max(map(deviation, found.used)) < 0.8
    assert found.rms < 0.3
    assert all(deviation(line) > 0.3 for line in found.rejected)


def test_a_straightened_picture_has_straight_lines(scene, found):
    straight = found.undistort(scene.picture)
    assert straight.shape == scene.picture.shape
    again = ts.straighten(straight)
    largest = np.abs(again.camera.displacement_map().displacement).max()
    assert largest < 0.05 * np.abs(found.camera.displacement_map().displacement).max()
    assert (straight.max(axis=2) > 0).all()
    assert (found.undistort(scene.picture, 1.0)[0, SIZE[0] // 2] == 0).all()


def test_grey_deep_and_large_pictures_give_the_same(scene, found):
    grey = cv2.cvtColor(scene.picture, cv2.COLOR_BGR2GRAY)
    twice = cv2.resize(grey, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    for picture, scale in ((grey, 1), (grey.astype(np.uint16) * 256, 1), (twice, 4)):
        camera = ts.straighten(picture).camera
        assert camera.image_size == (SIZE[0] * scale, SIZE[1] * scale)
        ratio = camera.undistort_points([[50 * scale, 40 * scale]]) / scale
        np.testing.assert_allclose(ratio, found.camera.undistort_points([[50, 40]]), atol=1.5)


def test_results_are_the_same_each_time_and_survive_pickling(scene, found):
    again = pickle.loads(pickle.dumps(ts.straighten(scene.picture)))
    np.testing.assert_array_equal(again.camera.covariance, found.camera.covariance)
    assert repr(again) == repr(found)
    assert not found.used[0].flags.writeable


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((480, 640), np.uint8),
        np.zeros((1, 1), np.uint8),
        np.ones((2, 400), np.uint8),
        NOISE,
    ],
    ids=["black", "one pixel", "a strip", "noise"],
)
def test_pictures_without_lines_are_refused(picture):
    with pytest.raises(ts.NotEnoughDataError, match="long edges"):
        ts.straighten(picture)


@pytest.mark.parametrize("draw", first_quick([arches, circles, spokes]))
@pytest.mark.parametrize("k1", first_quick([0.0, -0.15]))
def test_curves_and_lines_through_the_centre_are_refused(draw, k1):
    scene = plumb_scene(np.random.default_rng(6), SIZE, k1, draw)
    with pytest.raises((ts.NotEnoughDataError, ts.DegenerateGeometryError)):
        ts.straighten(scene.picture)


def test_arches_that_no_lens_makes_of_lines_are_named_as_curved():
    picture = np.full(SIZE[::-1], 200, np.uint8)
    for x in range(200, 800, 100):
        cv2.ellipse(picture, (x, 500), (150, 200), 0, 180, 360, 30, 4, cv2.LINE_AA)
    with pytest.raises(ts.NotEnoughDataError, match="curved no more than a lens"):
        ts.straighten(picture)


def test_central_lines_are_refused():
    small = plumb_scene(np.random.default_rng(7), (320, 240), 0.0).picture
    picture = np.full((1200, 1600, 3), small[0, 0], np.uint8)
    picture[480:720, 640:960] = small
    with pytest.raises((ts.NotEnoughDataError, ts.DegenerateGeometryError)):
        ts.straighten(picture)


def test_a_picture_of_another_size_is_refused(found):
    with pytest.raises(ValueError, match="the camera's pictures have 960 x 720"):
        found.undistort(NOISE[:-1])
    with pytest.raises(ValueError, match="balance"):
        found.undistort(NOISE, 1.5)


@pytest.mark.parametrize("k1", [0.0, -0.25])
def test_a_held_centre_is_said_without_a_deviation(run, tmp_path, k1):
    seed, centre = (5, None) if k1 == 0.0 else (4, np.array([505.0, 340.0]))
    scene = plumb_scene(np.random.default_rng(seed), SIZE, k1, centre=centre)
    photo = tmp_path / "photo.png"
    photo.write_bytes(encode_image(scene.picture, photo))
    code, out, _ = run("straighten", photo, "-o", tmp_path / "out.png")
    assert code == 0
    (line,) = (line for line in out.splitlines() if line.startswith("centre of distortion"))
    if k1 == 0.0:
        assert re.fullmatch(
            r"centre of distortion, px: cx 479\.5, cy 359\.5, fixed at the picture's centre: the "
            r"lines determine it only to \d+ and \d+ px",
            line,
        )
    else:
        assert re.fullmatch(r"[^:]+: cx 5\S+ \+- \S+, cy 3\S+ \+- \S+", line)


def test_command_writes_the_camera_for_further_pictures(run, tmp_path):
    picture = plumb_scene(np.random.default_rng(3), (640, 480), -0.15).picture
    photo, output, file = (tmp_path / name for name in ("photo.png", "out.png", "camera.json"))
    photo.write_bytes(encode_image(picture, photo))
    words = ("straighten", photo, "-o", output, "--save-camera", file)
    code, _, err = run(*words)
    assert code == 2
    assert "--save-camera and --focal go together: straight lines do not determine" in err
    code, _, err = run(*words[:-1], tmp_path / "camera.cam", "--focal", "600")
    assert (code, "let it end with one of" in err) == (2, True)
    assert not output.exists()

    code, out, _ = run(*words, "--focal", "600", "--json")
    assert (code, json.loads(out)["camera_file"]) == (0, str(file))
    camera = ts.Camera.load(file)
    expected = ts.straighten(picture).camera.camera(600.0)
    assert (camera.fx, camera.fy) == (600.0, 600.0)
    np.testing.assert_array_equal(camera.distortion, expected.distortion)
    code, _, err = run(*words, "--focal", "28")
    assert code == 2
    assert "--focal 28 is in pixels" in err
    _, out, _ = run(*words, "--focal", "600")
    assert "focal length: unknown" not in out
    assert f"wrote {file}, a camera of the model {expected.model}" in out


def test_command_keeps_the_orientation_tag(run, tmp_path):
    picture = plumb_scene(np.random.default_rng(3), (640, 480), -0.15).picture
    photo, output = tmp_path / "photo.png", tmp_path / "out.jpg"
    photo.write_bytes(with_orientation(encode_image(picture, photo), 8))
    code, _, err = run("straighten", photo, "-o", output)
    assert (code, err, find_orientation(output.read_bytes()).value) == (0, "", 8)
    code, _, err = run("straighten", photo, "-o", tmp_path / "out.bmp")
    assert (code, err.count("\n")) == (0, 1)
    assert "does not keep the photograph's orientation tag (turned anticlockwise" in err
