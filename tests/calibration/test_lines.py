"""Straight lines of the scene beside squares."""

import pickle

import cv2
import numpy as np
import plumb_scenes
import pytest

import trisquare as ts
from trisquare.simulate import edge_points, render
from trisquare.simulate.scene import TrueCamera, rectangle
from trisquare_scenes.scene_lines import central_scene, imaged_lines, line_samples

SIZE = (1280, 960)
NOISE = 0.1
SURE = 5.0
LINES = 12
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2")


def scene_of(seed, noise=NOISE, bends=()):
    """A scene, its squares and its lines; `bends` are those of the first lines, in pixels."""
    rng = np.random.default_rng([163, seed])
    scene = central_scene(rng)
    squares = [ts.PlaneEdges.square(s) for s in edge_points(scene, rng, noise=noise, spacing=4.0)]
    lines = imaged_lines(scene.camera, rng, LINES)
    bends = [*bends, *[0.0] * (LINES - len(bends))]
    pairs = zip(lines, bends, strict=True)
    samples = [line_samples(line, rng, noise, bend) for line, bend in pairs]
    return scene, squares, [ts.PlaneEdges.line(points) for points in samples]


def values(camera):
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion[:2]])


def off(result, scene):
    """Errors of the camera in their own standard deviations."""
    std = [result.std[name] for name in NAMES]
    return (values(result.camera) - values(scene.camera)) / std


@pytest.mark.parametrize("seed", [0, 1])
def test_lines_tell_the_distortion_where_no_square_is(seed):
    scene, squares, lines = scene_of(seed)
    alone = ts.calibrate_edges(squares, SIZE)
    # The order is arbitrary; the planes and their residuals remain those of the squares.
    result = ts.calibrate_edges([*lines[:5], *squares, *lines[5:]], SIZE)
    assert np.abs(off(result, scene)).max() < SURE
    assert all(line.is_used and line.rms < 2 * NOISE for line in result.lines)
    assert all(result.std[name] < alone.std[name] for name in NAMES)
    assert result.std["k2"] < 0.1 * alone.std["k2"]
    assert len(result.planes) == len(result.edges) == len(result.residuals) == 3
    assert result.rms < 1.5 * NOISE
    assert alone.lines == ()
    assert "lines" not in alone.to_json()


def test_without_noise_the_camera_is_exact():
    scene, squares, lines = scene_of(2, noise=0.0)
    result = ts.calibrate_edges([*squares, *lines], SIZE)
    assert all(line.is_used for line in result.lines)
    np.testing.assert_allclose(values(result.camera), values(scene.camera), rtol=1e-6, atol=1e-5)


def test_the_poses_follow_the_lens():
    _scene, squares, lines = scene_of(3)
    result = ts.calibrate_edges([*squares, *lines], SIZE)
    held = ts.calibrate_edges(
        squares, SIZE, fix=("focal", "principal_point", "distortion"), initial=result.camera
    )
    for own, other in zip(result.planes, held.planes, strict=True):
        std = own.uncertainty.given_camera.diagonal() ** 0.5
        assert (np.abs(own.translation - other.translation) < 0.1 * std[3:]).all()
    assert result.rms == pytest.approx(held.rms, rel=1e-2)


@pytest.mark.parametrize("model", ["auto", "fisheye2"])
def test_bent_lines_are_rejected_with_the_reason(model):
    bends = (1.0, -3.0, 5.0)
    scene, squares, lines = scene_of(4, bends=bends)
    result = ts.calibrate_edges([*squares, *lines], SIZE, model=model)
    if model == "fisheye2":  # the lens is no fisheye
        assert result.lines
        return
    used = [line.is_used for line in result.lines]
    assert used == [False] * 3 + [True] * (LINES - 3)
    assert "not straight" in result.lines[0].rejection
    assert result.camera.model in ("radial1", "radial2", "radial3")
    assert abs(result.camera.fx - scene.camera.fx) < SURE * result.std["fx"]


def test_lines_that_are_all_curved_change_nothing():
    _, squares, lines = scene_of(5, bends=np.linspace(3.0, 40.0, LINES) * np.resize([1, -1], LINES))
    alone = ts.calibrate_edges(squares, SIZE)
    result = ts.calibrate_edges([*squares, *lines], SIZE)
    if not any(line.is_used for line in result.lines):
        assert [w.code for w in result.warnings] == ["lines_not_used"]
        assert np.array_equal(result.covariance, alone.covariance)
    assert abs(result.camera.fx - alone.camera.fx) < 3 * alone.std["fx"]


def test_results_travel():
    _, squares, lines = scene_of(6, bends=(4.0,))
    result = ts.calibrate_edges([*squares, *lines], SIZE)
    for copy in (pickle.loads(pickle.dumps(result)), ts.Calibration.from_json(result.to_json())):
        for own, other in zip(copy.lines, result.lines, strict=True):
            assert np.array_equal(own.points, other.points)
            assert (own.rms, own.rejection) == (other.rms, other.rejection)
    assert "11 of 12 lines" in repr(result)
    assert "rejected" in repr(result.lines[0])
    line = ts.PlaneEdges.from_json(lines[0].to_json())
    assert line.freedom == "line"
    assert np.array_equal(line.points[0], lines[0].points[0])


def test_bad_lines_are_refused():
    _, squares, lines = scene_of(7)
    points = lines[0].points[0]
    with pytest.raises(ts.NotEnoughDataError, match="at least 3"):
        ts.PlaneEdges.line(points[:2])
    with pytest.raises(ValueError, match="finite"):
        ts.PlaneEdges.line([*points[:4], [np.nan, 3.0]])
    with pytest.raises(ValueError, match="plane=None"):
        ts.PlaneEdges([[0, 1, 0]], [points], plane=0, freedom="line")
    with pytest.raises(ValueError, match="one line"):
        ts.PlaneEdges([[0, 1, 0], [1, 0, 0]], [points, points], freedom="line")
    with pytest.raises(ValueError, match="circles"):
        ts.PlaneEdges(np.empty((0, 3)), [points], radii=(1.0,), freedom="line")
    with pytest.raises(ts.NotEnoughPlanesError, match=r"trisquare\.straighten"):
        ts.calibrate_edges(lines, SIZE)
    with pytest.raises(ValueError, match="maximum-likelihood method"):
        ts.calibrate_edges([*squares, *lines], SIZE, method="linear")
    blank = np.full((480, 640), 128, np.uint8)
    with pytest.raises(ValueError, match="ml"):
        ts.calibrate(blank, lines=True, method="linear")
    with pytest.raises(TypeError, match="lines"):
        ts.calibrate(blank, lines="yes")


@pytest.fixture(scope="module")
def pictured():
    """A picture of small squares on sheets in front of a wall of windows, and its camera."""
    rng = np.random.default_rng(11)
    focal, middle = plumb_scenes.FOCAL * SIZE[0], (np.array(SIZE) - 1) / 2
    camera = TrueCamera(focal, focal, *middle, np.array([-0.15, 0, 0, 0, 0]), SIZE)
    scene = central_scene(rng, camera)
    pinhole = TrueCamera(focal, focal, *middle, np.zeros(5), SIZE)

    def draw(rng, canvas):
        plumb_scenes.windows(rng, canvas)
        centre = (np.array(canvas.shape[1::-1]) - 1) / 2
        for target in scene.targets:
            for half, colour in ((0.75, (235,) * 3), (0.5, (30,) * 3)):
                corners = pinhole.project(target.to_camera(rectangle(half, half)))
                quad = (corners - middle) * plumb_scenes.SUPERSAMPLING + centre
                fixed = np.rint(quad * 2**plumb_scenes.SHIFT).astype(np.int32)
                cv2.fillPoly(canvas, [fixed], colour, cv2.LINE_AA, plumb_scenes.SHIFT)

    return plumb_scenes.plumb_scene(rng, SIZE, -0.15, draw).picture, camera


def test_the_lines_of_a_picture_are_found_and_used(pictured):
    picture, camera = pictured
    alone, result = ts.calibrate(picture), ts.calibrate(picture, lines=True)
    assert len(result.planes) == len(alone.planes) == 3
    used = [line for line in result.lines if line.is_used]
    assert len(used) >= 10
    hulls = [cv2.convexHull(plane.corners.astype(np.float32)) for plane in result.planes]
    for line in used:
        middle = tuple(line.points[len(line.points) // 2].tolist())
        assert all(cv2.pointPolygonTest(hull, middle, False) < 0 for hull in hulls)
    assert abs(result.camera.fx - alone.camera.fx) < 3 * alone.std["fx"]
    assert result.std["k1"] < 0.3 * alone.std["k1"]
    for name in NAMES:
        error = dict(zip(NAMES, values(result.camera) - values(camera), strict=True))[name]
        assert abs(error) < SURE * result.std[name], name


def test_a_picture_without_lines_is_calibrated_from_its_squares(pictured):
    scene = central_scene(np.random.default_rng(5), pictured[1])
    picture = render(scene, np.random.default_rng(6))
    alone, result = ts.calibrate(picture), ts.calibrate(picture, lines=True)
    assert result.lines == ()
    assert "no_lines" in [warning.code for warning in result.warnings]
    assert np.array_equal(result.camera.K, alone.camera.K)
