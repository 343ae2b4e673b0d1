"""Inputs at the limits of what is admissible: a result or an error of ours, in bounded time."""

import json
import math
import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first_quick
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare import _core

NOISE = 0.05
SECONDS = 8  # of processor time, on a slow processor; the cases used to take a minute and more


@pytest.fixture(scope="module")
def edges():
    return edges_of(squares(5), noise=NOISE, seed=1)


@pytest.fixture(scope="module")
def result(edges):
    return ts.calibrate_edges(edges, IMAGE_SIZE)


def drifting(edges, numbers):
    """Return the figures with given picture numbers and an estimated tone curve."""
    return [
        ts.PlaneEdges(
            figure.lines,
            figure.points,
            image=number,
            drift=[np.full_like(side, 0.02) for side in figure.points],
        )
        for figure, number in zip(edges, numbers, strict=False)
    ]


@pytest.mark.parametrize("number", [30_000, 10**6, 2**60, 2**62 + 1, 2**63 - 1])
def test_a_picture_number_is_a_name_and_no_size(edges, number):
    counted = ts.calibrate_edges(drifting(edges, (0, 0, 1)), IMAGE_SIZE)
    named = [
        ts.PlaneEdges.from_json(figure.to_json()) for figure in drifting(edges, (7, 7, number))
    ]
    found = ts.calibrate_edges(named, IMAGE_SIZE)
    assert [plane.image for plane in found.planes] == [7, 7, number]
    assert np.array_equal(found.camera.K, counted.camera.K)
    assert np.array_equal(found.covariance, counted.covariance)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_panic_of_the_core_asks_for_a_report(capfd, threads):
    with pytest.raises(ts.InternalError, match="please report it with the input") as caught:
        _core.provoke_panic(threads)
    assert "failed inside its core: a panic was asked for (errors.rs:" in str(caught.value)
    assert isinstance(caught.value, ts.TrisquareError)
    assert capfd.readouterr().err == ""
    # The failure has no after-effects.
    assert ts.Camera([[9, 0, 4], [0, 9, 4], [0, 0, 1]], np.zeros(5), (9, 9)).unproject([[4, 4]])[
        0, 2
    ]


@pytest.mark.parametrize(
    "homography",
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[1, 0, 1], [0, 1, 1], [0, 0, 0]],
        [[1, 1, 0], [0, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1e300]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1e-300]],
        np.zeros((3, 3)),
    ],
)
def test_a_homography_that_shows_no_plane_has_no_pose(homography):
    with pytest.raises(ts.DegenerateGeometryError):
        ts.pose_from_homography(np.eye(3), homography)


coefficient = st.floats(-1, 1).flatmap(
    lambda sign: st.floats(-4, 5).map(lambda power: sign * 10**power)
)


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(coefficient, coefficient, coefficient),
    st.one_of(st.just((0.0, 0.0)), st.tuples(st.floats(-1, 1), st.floats(-1, 1))),
    st.floats(0, 2 * math.pi),
    st.floats(-9, -0.1),
)
def test_a_pixel_near_the_rim_comes_back_or_is_refused(k, p, angle, rim):
    K = [[900, 0, 640], [0, 1100, 480], [0, 0, 1]]
    camera = ts.Camera(K, [k[0], k[1], *p, k[2]], IMAGE_SIZE, "brown")
    radius = min(camera.valid_radius or 2.0, 2.0) * (1 - 10**rim)
    pixels = camera.project([[radius * math.cos(angle), radius * math.sin(angle), 1.0]])
    try:
        again = camera.project(camera.unproject(pixels))
    except ValueError:
        return
    far = np.linalg.norm(pixels - [640, 480])
    assert np.linalg.norm(again - pixels) <= 1e-9 * max(1.0, far / 1e4)


@pytest.mark.parametrize("k1", [-1e308, -1e300])
def test_a_lens_that_is_nowhere_invertible_is_refused(k1):
    K = [[900, 0, 640], [0, 900, 480], [0, 0, 1]]
    with pytest.raises(ValueError, match="valid radius is 0 px"):
        ts.Camera(K, [k1, 0, 0, 0, 0], IMAGE_SIZE)


@pytest.mark.parametrize("size", [(1, 10**9), (10**9, 1), (170, 400_000), (1, 1), (10**9, 10**9)])
def test_pictures_of_any_shape_are_compared_in_time(size):
    width, height = size
    K = [[9e3, 0, width / 2], [0, 9e3, height / 2], [0, 0, 1]]
    first = ts.Camera(K, [-0.1, 0.02, 0, 0, 0], size)
    second = ts.Camera(K, [0.3, 0.9, 0.01, 0.02, 3.0], size, "brown")
    begun = time.process_time()
    try:
        assert ts.compare(first, second).verdict
    except ValueError as error:
        assert "both distortions can be inverted in only" in str(error)  # noqa: PT017
    assert time.process_time() - begun < SECONDS


def test_a_grid_of_too_many_places_is_refused(result):
    with pytest.raises(ValueError, match="too small"):
        result.projection_map(step=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 5), st.integers(0, 5), st.floats(-1e12, 1e12))
def test_a_covariance_that_is_none_is_refused(result, row, column, value):
    members = json.loads(result.to_json())
    members["covariance"][row][column] = value
    try:
        read = ts.Calibration.from_json(json.dumps(members))
    except ValueError as error:
        assert '"covariance"' in str(error)  # noqa: PT017
        return
    std = np.sqrt(np.diag(read.covariance))
    correlation = read.covariance / np.where(std > 0, np.outer(std, std), 1.0)
    assert np.linalg.eigvalsh(correlation).min() > -1e-5
    with np.errstate(all="raise"):
        assert np.isfinite(read.projection_std([[10.0, 20.0]])).all()


def test_a_covariance_of_a_calibration_is_one(result):
    assert np.array_equal(ts.Calibration.from_json(result.to_json()).covariance, result.covariance)
    assert np.array_equal(pickle.loads(pickle.dumps(result)).covariance, result.covariance)


def small_figures(seed):
    """Return a few squares of few samples in three pictures, with arbitrary noise."""
    rng = np.random.default_rng(seed)
    K = [[1000, 0, 640], [0, 1000, 480], [0, 0, 1]]
    camera = ts.Camera(K, [-0.1, 0.02, 0, 0, 0], IMAGE_SIZE)
    noise = 10 ** rng.uniform(0, 2)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    lines = [[0, 1, 0.5], [-1, 0, 0.5], [0, -1, 0.5], [1, 0, 0.5]]
    figures = []
    for _ in range(rng.integers(4, 9)):
        turn = np.linalg.qr(np.eye(3) + 0.5 * rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.diag(turn))
        place = [rng.uniform(-0.8, 0.8), rng.uniform(-0.6, 0.6), rng.uniform(4, 8)]
        along = (np.arange(3) + 0.5)[:, None] / 3
        sides = []
        for i in range(4):
            on_plane = corners[i] + (corners[(i + 1) % 4] - corners[i]) * along
            points = np.column_stack([on_plane, np.zeros(3)]) @ turn.T + place
            sides.append(camera.project(points) + noise * rng.normal(size=(3, 2)))
        drift = [0.1 * rng.normal(size=(3, 2)) for _ in range(4)]
        figures.append(ts.PlaneEdges(lines, sides, image=int(rng.integers(3)), drift=drift))
    return figures


@pytest.mark.parametrize("seed", first_quick([3, 0, 1, 2]))
def test_small_figures_of_much_noise_take_no_minute(seed):
    figures = small_figures(seed)
    begun = time.process_time()
    try:
        ts.calibrate_edges(figures, IMAGE_SIZE, model="auto")
    except ts.TrisquareError as error:
        assert str(error)  # noqa: PT017
    assert time.process_time() - begun < SECONDS


@pytest.mark.filterwarnings("error")
@settings(max_examples=100, deadline=None)
@given(st.tuples(*[st.floats(-1e300, 1e300)] * 3), st.floats(-300, 300))
def test_no_warning_escapes_from_maps_of_far_points(point, power):
    f = 10.0**power
    camera = ts.Camera([[f, 0, 640], [0, f, 480], [0, 0, 1]], np.zeros(5), IMAGE_SIZE)
    for ask, where in [
        (camera.project, [point]),
        (camera.can_project, [point]),
        (camera.unproject, [point[:2]]),
        (camera.distort_points, [point[:2]]),
        (camera.undistort_points, [point[:2]]),
    ]:
        try:
            assert np.isfinite(ask(where)).all()
        except ValueError as error:
            assert "point" in str(error)  # noqa: PT017
