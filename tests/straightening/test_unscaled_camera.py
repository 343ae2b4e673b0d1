"""`UnscaledCamera`: its maps, their inverses, standard deviations and conversion."""

import numpy as np
import pytest

import trisquare as ts
from trisquare.straightening.radial import RadialLens

SIZE = (1280, 960)
STD = {"a1": 1e-3, "a2": 2e-3, "a3": 1e-3, "cx": 3.0, "cy": 4.0}
LENSES = [
    ("division", (-0.25, -0.02)),
    ("division", (0.08, -0.01)),
    ("division", (-0.67, -0.12)),
    ("polynomial", (-0.135, 0.0)),
    ("polynomial", (-0.16, 0.035)),
    ("polynomial", (0.04, 0.001)),
    ("division", (0.0, 0.0)),
    ("polynomial", (-0.29, 0.08, -0.008)),
    ("division", (-0.3, -0.1, 0.06)),
]


def camera_of(family, coefficients, centre=(650.0, 470.0)):
    return ts.UnscaledCamera(SIZE, family, coefficients, centre, covariance_of(coefficients))


def covariance_of(coefficients):
    names = [*("a1", "a2", "a3")[: len(coefficients)], "cx", "cy"]
    return np.diag([STD[name] ** 2 for name in names])


@pytest.fixture(params=LENSES, ids=str)
def camera(request):
    return camera_of(*request.param)


def inner_points(camera, part=0.95):
    rng = np.random.default_rng(1)
    limit = min(camera.valid_radius_px or np.inf, camera.radius) * part
    angle, radius = rng.uniform(0, 2 * np.pi, 200), limit * np.sqrt(rng.uniform(0, 1, 200))
    return camera.centre + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def test_distorting_undoes_undistorting(camera):
    points = inner_points(camera)
    ideal = camera.undistort_points(points)
    np.testing.assert_allclose(camera.distort_points(ideal), points, atol=1e-7)
    np.testing.assert_allclose(camera.undistort_points([camera.centre]), [camera.centre])
    np.testing.assert_allclose(camera.distort_points([camera.centre]), [camera.centre])


def test_derivatives_of_the_divisor_agree_with_differences(camera):
    lens = camera.radial
    square = (np.linspace(0.05, 0.9, 30) * min(lens.largest_radius(), 1.0)) ** 2
    _, slope, by_coefficients = lens.divisor(square)
    step = 1e-6
    ahead, behind = lens.divisor(square + step)[0], lens.divisor(square - step)[0]
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-6, rtol=1e-5)
    for column, change in enumerate(step * np.eye(len(lens.coefficients))):
        ahead, behind = (
            RadialLens(lens.family, lens.coefficients + sign * change).divisor(square)[0]
            for sign in (1, -1)
        )
        expected = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(by_coefficients[:, column], expected, atol=1e-6, rtol=1e-5)


def test_the_std_of_the_displacement_is_that_of_drawn_lenses(camera):
    displaced = camera.displacement_map(200)
    close = np.linalg.norm(displaced.points - camera.centre, axis=1)
    inner = close < 0.8 * min(camera.valid_radius_px or np.inf, camera.radius)
    points, std = displaced.points[inner], displaced.std[inner]
    rng = np.random.default_rng(2)
    draws = []
    covariance = camera.covariance
    for change in rng.multivariate_normal(np.zeros(len(covariance)), covariance, 400):
        moved = camera_of(
            camera.family, camera.coefficients + change[:-2], camera.centre + change[-2:]
        )
        draws.append(moved.undistort_points(points))
    np.testing.assert_allclose(np.std(draws, axis=0), std, rtol=0.2, atol=0.02)


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan, 1e-6, 1e-320])
def test_a_step_of_no_map_is_refused(camera, step):
    with pytest.raises(ValueError, match="step"):
        camera.displacement_map(step)


def test_a_focal_length_makes_it_a_camera(camera):
    focal = 560.0
    made = camera.camera(focal)
    assert (made.fx, made.fy, made.cx, made.cy) == (focal, focal, *camera.centre)
    points = inner_points(camera, 0.9)
    ideal = camera.undistort_points(points)
    off = (ideal - camera.centre) / focal
    seen = made.project(np.column_stack([off, np.ones(len(off))]))
    exact = camera.family == "polynomial"
    np.testing.assert_allclose(seen, points, atol=1e-6 if exact else 0.5)


def test_a_focal_length_that_no_model_can_have_is_refused():
    with pytest.raises(ts.LensModelError, match="no lens model") as caught:
        camera_of("division", (-0.9, -0.3)).camera(1500.0)
    assert isinstance(caught.value.nearest, ts.Camera)
    assert caught.value.worst > 0.5


def test_no_point_comes_back_from_beyond_the_valid_radius():
    camera = camera_of("polynomial", (-0.3, 0.0))
    limit = camera.valid_radius_px
    assert limit < camera.radius
    for method in (camera.undistort_points, camera.distort_points):
        with pytest.raises(ValueError, match="1 of 2 points lie beyond"):
            method([camera.centre, camera.centre + np.array([0, 3 * camera.radius])])


def test_unknown_stays_unknown_and_nonsense_is_refused():
    camera = camera_of("division", (-0.2, 0.0))
    assert not hasattr(camera, "K")
    assert camera.std == pytest.approx({name: STD[name] for name in ("a1", "a2", "cx", "cy")})
    for value in (0.0, -3.0, np.nan):
        with pytest.raises(ValueError, match="focal_length"):
            camera.camera(value)
    with pytest.raises(ValueError, match="family"):
        camera_of("brown", (0.0, 0.0))
    with pytest.raises(ValueError, match="NaN"):
        camera_of("division", (np.nan, 0.0))
    with pytest.raises(ValueError, match="two or three, not 1"):
        ts.UnscaledCamera(SIZE, "division", [0.0], (1, 1), np.eye(3))
    with pytest.raises(ValueError, match="covariance"):
        ts.UnscaledCamera(SIZE, "division", (0, 0, 0), (1, 1), np.eye(4))
    with pytest.raises(ValueError, match="covariance"):
        ts.UnscaledCamera(SIZE, "division", (0, 0), (1, 1), -np.eye(4))
    with pytest.raises(ValueError, match="step"):
        camera.displacement_map(0)
