"""Lenses of OpenCV's rational and thin prism models, and all functions for them."""

import json
import pickle

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE

import trisquare as ts
from trisquare.camera.camera import camera_parameters
from trisquare.simulate import edge_points, random_scene, render
from trisquare.simulate.scene import TrueCamera
from trisquare_scenes.other_lenses import PrismCamera, RationalCamera

K = np.array([[900.0, 0.0, 652.0], [0.0, 904.0, 471.0], [0.0, 0.0, 1.0]])
RATIONAL = (0.15, 0.02, 2e-3, -1e-3, 0.01, 0.4, 0.05, -0.01)
PRISM = (2e-3, -1e-3, 3e-3, 2e-3)
CAMERAS = {
    "rational": RATIONAL,
    "brown_prism": (*RATIONAL[:5], 0.0, 0.0, 0.0, *PRISM),
    "thin_prism": (*RATIONAL, *PRISM),
}
FREE = {
    "rational": "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2",
    "brown_prism": "fx fy cx cy k1 k2 k3 p1 p2 s1 s2 s3 s4",
    "thin_prism": "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4",
}
INTRINSICS = ("fx", "fy", "cx", "cy")
NOISE, SPACING = 0.1, 6.0


def camera_of(model):
    return ts.Camera(K, CAMERAS[model], IMAGE_SIZE, model)


def wide(rng):
    """A wide lens whose radial distortion is a quotient of polynomials."""
    above, below = 0.0, 1.0
    square = np.linspace(0.0, 25.0, 500)
    # Draw until the lens sees all of the picture: the radius grows with that of the ideal point.
    while np.any((1 + above * square) * (1 + below * square) < 2 * square * (below - above)):
        below = rng.uniform(0.3, 0.9)
        above = below - rng.uniform(0.1, 0.3)
    return RationalCamera(
        780.0, 784.0, 650.0, 470.0, np.zeros(5), IMAGE_SIZE, above=above, below=below
    )


def prismatic(rng):
    distortion = [rng.uniform(-0.3, 0.1), 0.05, *rng.normal(0.0, 1e-3, 2), 0.0]
    return PrismCamera(
        1250.0, 1255.0, 650.0, 470.0, distortion, IMAGE_SIZE, prism=rng.normal(0.0, 0.004, 4)
    )


def usual(rng):
    distortion = [rng.uniform(-0.3, 0.1), rng.uniform(0.0, 0.1), 0.0, 0.0, 0.0]
    return TrueCamera(1250.0, 1255.0, 650.0, 470.0, distortion, IMAGE_SIZE)


def calibrated(scene, rng, model):
    points = edge_points(scene, rng, noise=NOISE, spacing=SPACING)
    edges = [ts.PlaneEdges.square(sides) for sides in points]
    return ts.calibrate_edges(edges, image_size=IMAGE_SIZE, model=model)


@pytest.fixture(scope="module")
def seen():
    """A scene under a lens with a quotient of polynomials, and the calibration from its edges."""
    rng = np.random.default_rng(151)
    scene = random_scene(rng, camera=wide(rng))
    return scene, calibrated(scene, rng, "rational")


@pytest.mark.parametrize("model", CAMERAS)
def test_its_maps_are_those_of_opencv(model):
    camera = camera_of(model)
    assert camera.distortion.shape == ((8,) if model == "rational" else (12,))
    rng = np.random.default_rng(152)
    points = np.column_stack([rng.uniform(-0.7, 0.7, (50, 2)), np.ones(50)]) * 2.0
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    pixels = camera.project(points)
    assert np.abs(pixels - expected[:, 0]).max() < 1e-9
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    # OpenCV 5 merged it into undistortPoints.
    undistorted = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    ideal = undistorted(
        pixels[:, None], camera.K, camera.distortion, R=None, P=camera.K, criteria=criteria
    )
    assert np.abs(camera.undistort_points(pixels) - ideal[:, 0]).max() < 1e-7
    assert np.abs(camera.distort_points(camera.undistort_points(pixels)) - pixels).max() < 1e-9
    rays = camera.unproject(pixels)
    assert np.abs(rays[:, :2] / rays[:, 2:] - points[:, :2] / 2.0).max() < 1e-11


def test_nothing_is_seen_beyond_a_pole_or_a_fold():
    pole = ts.Camera(K, [0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0], IMAGE_SIZE, "rational")
    assert 0.0 < 2.0 - pole.valid_radius < 1e-8
    assert pole.can_project([[1.9, 0.0, 1.0], [2.1, 0.0, 1.0]]).tolist() == [True, False]
    fold = ts.Camera(K, [-0.3, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0], IMAGE_SIZE, "rational")
    with pytest.raises(ValueError, match="beyond the valid radius"):
        fold.project([[fold.valid_radius * 1.01, 0.0, 1.0]])
    reach = fold.valid_radius_px
    edge = [[fold.cx, fold.cy + reach * 0.999]]
    assert np.abs(fold.distort_points(fold.undistort_points(edge)) - edge).max() < 1e-9
    with pytest.raises(ValueError, match="beyond the valid radius"):
        fold.undistort_points([[fold.cx, fold.cy + reach * 1.05]])


@pytest.mark.parametrize(
    ("model", "lens"),
    first_quick(
        [
            ("rational", usual),
            ("rational", wide),
            ("brown_prism", prismatic),
            ("thin_prism", prismatic),
        ]
    ),
)
def test_standard_deviations_are_those_of_the_errors(model, lens):
    scores, ratios = [], []
    for seed in range(20):
        rng = np.random.default_rng([153, seed])
        scene = random_scene(rng, camera=lens(rng))
        result = calibrated(scene, rng, model)
        assert result.parameters == tuple(FREE[model].split())
        truth = scene.camera
        errors = [getattr(result.camera, name) - getattr(truth, name) for name in INTRINSICS]
        scores.append([e / result.std[name] for e, name in zip(errors, INTRINSICS, strict=True)])
        ratios.append(_map_error(result, truth))
    # 80 correlated, normalised errors.
    assert 0.75 < np.sqrt(np.mean(np.square(scores))) < 1.3
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def _map_error(result, truth):
    """The rms error of the projection over its stated rms."""
    stated = result.projection_map(step=160.0, rotation="held")
    pixels = np.stack(np.meshgrid(stated.x, stated.y), axis=-1).reshape(-1, 2)
    rays = truth.rays(pixels)
    # A lens may fold back at a corner where its estimate is uncertain.
    known = result.camera.can_project(rays)
    assert known.mean() > 0.9
    off = result.camera.project(rays[known]) - pixels[known]
    std = stated.std.ravel()[known]
    return np.sqrt(np.mean(np.sum(off**2, axis=1)) / np.mean(std**2))


def test_a_fit_that_turns_back_where_no_edge_runs_is_searched_among_lenses_that_do_not():
    """Holding the coefficients at zero used to leave 1 px, twenty times the noise."""
    noise, cells, samples = 0.05, 6, 60
    coefficients = np.array([0.3, 0.05, 3e-4, -2e-4, 0.002, 0.6, 0.12, 0.01])
    matrix = np.array([[620.0, 0.0, 650.0], [0.0, 622.0, 470.0], [0.0, 0.0, 1.0]])
    truth = ts.Camera(matrix, coefficients, IMAGE_SIZE, "rational")
    rng = np.random.default_rng(157)
    edges = []
    for turn, place in zip(np.diag([0.7, -0.7, 0.5]), ([-4, -2], [4, -2], [0, 2]), strict=True):
        lines, points = [], []
        for axis in (0, 1):
            for line in range(cells + 1):
                on_plane = np.zeros((samples, 3))
                on_plane[:, axis] = line - cells / 2
                on_plane[:, 1 - axis] = np.linspace(-cells / 2, cells / 2, samples)
                shifted = on_plane @ cv2.Rodrigues(turn)[0].T + [*place, 8.0]
                points.append(truth.project(shifted) + rng.normal(0.0, noise, (samples, 2)))
                lines.append([1.0 - axis, axis, -line])
        edges.append(ts.PlaneEdges(lines, points, kind="chessboard"))
    result = ts.calibrate_edges(edges, image_size=IMAGE_SIZE, model="rational")
    assert result.rms < 1.1 * noise
    corners = [[0, 0], [1279, 0], [1279, 959], [0, 959]]
    assert np.isfinite(result.camera.unproject(corners)).all()
    for name in INTRINSICS:
        assert abs(getattr(result.camera, name) - getattr(truth, name)) < 4.0 * result.std[name]


def test_a_picture_is_answered_within_its_standard_deviations():
    rng = np.random.default_rng(154)
    scene = random_scene(rng, camera=wide(rng))
    result = ts.calibrate(render(scene, rng), model="rational", tone="linear")
    assert result.stage == "pixels"
    for name in INTRINSICS:
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < 4.5 * result.std[name], name


def test_a_picture_through_a_prism_needs_the_principal_point():
    """Prism and tangential terms together have the same effect as another axis of the camera."""
    rng = np.random.default_rng(154)
    scene = random_scene(rng, camera=prismatic(rng))
    truth = scene.camera
    picture = render(scene, rng)
    with pytest.raises(ts.DegenerateGeometryError, match="fix the principal point"):
        ts.calibrate(picture, model="brown_prism", tone="linear")
    distortion = [*truth.distortion, 0.0, 0.0, 0.0, *truth.prism]
    known = ts.Camera(truth.K, distortion, IMAGE_SIZE, "brown_prism")
    result = ts.calibrate(
        picture, model="brown_prism", tone="linear", fix="principal_point", initial=known
    )
    assert result.stage == "pixels"
    for name in ("fx", "fy"):
        error = getattr(result.camera, name) - getattr(truth, name)
        assert abs(error) < 4.5 * result.std[name], name


def test_its_projection_is_as_uncertain_as_its_errors(seen):
    _, result = seen
    assert np.isfinite(result.projection_map(step=160.0).std).all()
    same = ts.compare(result, result.camera)
    assert same.rms < 1e-6
    narrow = ts.Camera(result.camera.K, np.zeros(5), IMAGE_SIZE, "none")
    assert ts.compare(result, narrow).rms > 1.0


def test_distances_are_measured_on_its_planes(seen):
    scene, result = seen
    corners = np.array([[-0.5, -0.5], [0.5, -0.5]])
    pixels = scene.camera.project(scene.targets[0].to_camera(corners))
    measured = ts.measure(result.planes[0], pixels, result)
    assert abs(measured.lengths[0] - 1.0) < 5 * measured.lengths_std[0]


def test_a_prediction_is_what_the_edges_then_tell(seen):
    scene, result = seen
    planned = ts.predict(result.camera, scene.targets, NOISE, spacing=SPACING, model="radial2")
    assert tuple(planned.parameters) == (*INTRINSICS, "k1", "k2")
    with pytest.raises(ValueError, match="no lens model of this camera"):
        ts.predict(result.camera, scene.targets, NOISE, model="fisheye")


@pytest.mark.parametrize("model", CAMERAS)
def test_it_goes_to_json_and_back(seen, model):
    scene, _ = seen
    result = calibrated(scene, np.random.default_rng(155), model)
    again = ts.Calibration.from_json(result.to_json())
    assert again.to_json() == result.to_json()
    count = 8 if model == "rational" else 12
    assert len(json.loads(result.to_json())["camera"]["distortion"]) == count
    copy = pickle.loads(pickle.dumps(result))
    assert camera_parameters(copy.camera) == camera_parameters(result.camera)
    if model == "brown_prism":
        assert not result.camera.distortion[5:8].any()


def test_pinhole_views_of_it_are_straight(seen):
    _, result = seen
    picture = np.zeros((960, 1280), np.uint8)
    for balance in (0.0, 1.0):
        assert ts.undistort(picture, result.camera, balance=balance).shape == picture.shape


def test_a_known_camera_locates_squares(seen):
    _, result = seen
    located = ts.calibrate_edges(
        result.edges,
        image_size=IMAGE_SIZE,
        model="rational",
        fix=("focal", "principal_point", "distortion"),
        initial=result.camera,
    )
    assert located.camera.distortion.tolist() == result.camera.distortion.tolist()
    with pytest.raises(ValueError, match="cannot be fixed"):
        ts.calibrate_edges(
            result.edges, IMAGE_SIZE, model="thin_prism", fix="distortion", initial=result.camera
        )
