"""The camera's maps: against OpenCV, as inverses of each other, and their refusals."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trisquare import Camera, fit_distortion
from trisquare.calibration.linear_steps import Straightening
from trisquare.camera.angles_of_view import angles_of_view

SIZE = (1280, 960)
K = np.array([[900.0, 0.0, 652.0], [0.0, 907.0, 471.0], [0.0, 0.0, 1.0]])
LENSES = {
    "none": [0, 0, 0, 0, 0],
    "radial1": [-0.15, 0, 0, 0, 0],
    "radial2": [-0.3, 0.09, 0, 0, 0],
    "radial3": [0.15, -0.1, 0, 0, 0.03],
    "brown": [-0.28, 0.08, 0.003, -0.002, -0.01],
}


def camera(model="brown", **options):
    return Camera(K, LENSES[model], SIZE, model, **options)


def pixel_grid(margin=0.0):
    x = np.linspace(-margin, SIZE[0] - 1 + margin, 41)
    y = np.linspace(-margin, SIZE[1] - 1 + margin, 31)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("model", LENSES)
def test_maps_agree_with_opencv(model):
    lens = camera(model)
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (200, 2)), np.ones(200)])
    points *= rng.uniform(0.5, 20.0, (200, 1))
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, lens.distortion.copy())[0]
    assert np.abs(lens.project(points) - seen.reshape(-1, 2)).max() < 1e-9
    ideal = points[:, :2] / points[:, 2:] * [900.0, 907.0] + [652.0, 471.0]
    assert np.abs(lens.distort_points(ideal) - seen.reshape(-1, 2)).max() < 1e-9
    # OpenCV's inverse iterates until the given criteria are met.
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 300, 1e-14)
    # OpenCV 5 merged the two functions.
    iterate = getattr(cv2, "undistortPointsIter", None) or cv2.undistortPoints
    back = iterate(seen, K, lens.distortion.copy(), R=np.eye(3), P=K, criteria=criteria)
    assert np.abs(lens.undistort_points(seen.reshape(-1, 2)) - back.reshape(-1, 2)).max() < 1e-9


def test_a_fisheye_sees_more_than_half_of_all():
    focal = 1280 / np.radians(200.0)  # the angle is proportional to the distance from the middle
    lens = Camera([[focal, 0, 639.5], [0, focal, 479.5], [0, 0, 1]], np.zeros(4), SIZE, "fisheye")
    assert angles_of_view(lens) == pytest.approx((200.0, 150.0))
    assert angles_of_view(camera("none"))[0] == pytest.approx(
        math.degrees(math.atan(652.5 / 900.0) + math.atan(627.5 / 900.0)), abs=1e-2
    )


def test_masked_points_are_refused():
    points = np.ma.array(pixel_grid(), mask=False)
    camera().undistort_points(points)
    points[3, 1] = np.ma.masked
    with pytest.raises(ValueError, match="observed contains masked values: leave them out"):
        camera().undistort_points(points)


def test_a_model_is_looked_up_and_coefficients_may_be_a_list_of_opencv_s():
    with pytest.raises(ValueError, match="did you mean 'radial2'"):
        Camera(K, LENSES["radial2"], SIZE, "Radial2")
    with pytest.raises(TypeError, match="a model must be a name, not list"):
        Camera(K, LENSES["radial2"], SIZE, ["radial2"])
    rows = np.reshape(LENSES["brown"], (1, 5)).tolist()
    assert Camera(K, rows, SIZE, "brown") == camera("brown")


def test_points_as_opencv_has_them_are_taken():
    lens = camera("brown")
    points = pixel_grid()[:, None]
    wanted = lens.undistort_points(points[:, 0])
    np.testing.assert_array_equal(lens.undistort_points(points), wanted)
    np.testing.assert_array_equal(lens.unproject(points.tolist()), lens.unproject(points[:, 0]))


@pytest.mark.parametrize("model", LENSES)
def test_maps_are_each_others_inverse(model):
    lens, pixels = camera(model), pixel_grid(margin=20)
    ideal, rays = lens.undistort_points(pixels), lens.unproject(pixels)
    assert np.abs(lens.distort_points(ideal) - pixels).max() < 1e-9
    assert np.abs(lens.project(7.0 * rays) - pixels).max() < 1e-9
    assert np.abs(lens.undistort_points(lens.distort_points(ideal)) - ideal).max() < 1e-9
    assert np.abs(np.linalg.norm(rays, axis=1) - 1.0).max() < 1e-14


def test_points_beyond_the_valid_radius_are_an_error():
    lens = camera("radial1")
    radius = lens.valid_radius
    assert radius == pytest.approx(math.sqrt(1 / 0.45))
    edge = np.array([[radius * 0.999, 0.0, 1.0], [0.0, radius * 1.001, 1.0], [3.0, 0.0, 1.0]])
    assert lens.project(edge[:1]).shape == (1, 2)
    with pytest.raises(ValueError, match=r"2 points \(the first has index 1\).*1\.4907"):
        lens.project(edge)
    with pytest.raises(ValueError, match=r"2 points \(the first has index 1\)"):
        lens.distort_points(edge[:, :2] * [900.0, 907.0] + [652.0, 471.0])
    # The largest observed radius is two thirds of the ideal one: nothing is seen farther out.
    rim = 652.0 + 900.0 * radius * 2 / 3
    for refuse in (lens.undistort_points, lens.unproject):
        with pytest.raises(ValueError, match=r"the point of index 2"):
            refuse([[652.0, 471.0], [rim - 1, 471.0], [rim + 1, 471.0]])


def test_points_whose_pixels_would_overflow_are_an_error():
    pinhole = Camera(np.diag([800.0, 800.0, 1.0]), np.zeros(5), (640, 480))
    with pytest.raises(ValueError, match=r"valid radius: the pixel would not be finite"):
        pinhole.project([[1e307, 0.0, 1.0]])


def test_points_behind_the_camera_are_an_error():
    with pytest.raises(ValueError, match=r"2 points \(the first has index 1\) lie behind"):
        camera().project([[0, 0, 1], [0, 0, -1], [0.1, 0, 0]])


def test_a_smaller_valid_radius_is_kept_to():
    lens = camera("radial1", valid_radius=0.5)
    assert lens.project([[0.49, 0.0, 1.0]]).shape == (1, 2)
    with pytest.raises(ValueError, match="valid radius"):
        lens.project([[0.51, 0.0, 1.0]])
    # A radius that is too large for the distortion does not make it invertible.
    with pytest.raises(ValueError, match="valid radius"):
        camera("radial1", valid_radius=math.inf).project([[1.5, 0.0, 1.0]])


def test_the_tangential_part_counts_in_the_valid_radius():
    radial, bent = camera("radial1"), Camera(K, [-0.15, 0, 0.01, -0.02, 0], SIZE, "brown")
    assert bent.valid_radius < radial.valid_radius
    # In the direction opposite to the tangential coefficients, the observed radius stops growing
    # there.
    away = -np.array([-0.02, 0.01]) / math.hypot(0.02, 0.01)
    radii = bent.valid_radius * np.array([0.999, 1.0, 1.001])
    x, y = away[:, None] * radii
    square = radii**2
    k1, _, p1, p2, _ = bent.distortion
    seen = x * (1 + k1 * square) + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    assert seen[1] == pytest.approx(max(seen, key=abs))
    assert len(set(np.sign(np.diff(seen)))) == 2


def test_every_pixel_within_the_valid_pixel_radius_comes_back():
    assert camera("none").valid_radius_px is None
    for model in ("radial1", "brown"):
        lens = camera(model)
        angle = np.linspace(0.0, 2 * np.pi, 100)
        circle = np.column_stack([np.cos(angle), np.sin(angle)]) * lens.valid_radius_px
        assert lens.undistort_points([652.0, 471.0] + 0.9999 * circle).shape == (100, 2)
        with pytest.raises(ValueError, match="valid radius"):
            lens.undistort_points([652.0, 471.0] + 1.05 * circle)


@pytest.mark.parametrize("method", ["project", "unproject", "distort_points", "undistort_points"])
def test_bad_points_are_refused_and_none_are_no_error(method):
    width = 3 if method == "project" else 2
    call = getattr(camera(), method)
    assert call(np.empty((0, width))).shape == (0, 3 if method == "unproject" else 2)
    for bad in (np.zeros((4, 5)), np.full((1, width), np.nan), np.zeros(width)):
        with pytest.raises(ValueError, match=r"shape|NaN"):
            call(bad)
    with pytest.raises(TypeError):
        call([["a"] * width])


def test_a_straightening_ends_at_its_first_fold():
    # The slope 1 - 1.5 s + 0.5 s^2 is positive again beyond s = 2.
    folded = Straightening([-0.5, 0.1], [640, 480], 800.0, 0.0)
    assert folded.undistort([[640.0 + 790.0, 480.0]]).shape == (1, 2)
    for radius in (810.0, 1300.0):
        with pytest.raises(ValueError, match="invertible"):
            folded.undistort([[640.0 + radius, 480.0]])
    with pytest.raises(ValueError, match="3 coefficients"):
        fit_distortion([np.zeros((9, 2))], SIZE, 4)


@st.composite
def strong_cameras(draw):
    """Cameras up to 70 degrees off the axis, with up to the strongest distortion of each model."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    fx = SIZE[0] * np.exp(rng.uniform(np.log(0.3), np.log(5.0)))
    centre = rng.normal([639.5, 479.5], [100.0, 80.0])
    matrix = [[fx, 0, centre[0]], [0, fx * rng.uniform(0.5, 2.0), centre[1]], [0, 0, 1]]
    reach = 800.0 / fx
    k1, k2, k3 = rng.uniform(-1.0, 1.0, 3) / reach ** np.array([2, 4, 6]) * (rng.random(3) < 0.6)
    p1, p2 = rng.uniform(-0.1, 0.1, 2) / reach * (rng.random() < 0.5)
    return Camera(matrix, [k1, k2, p1, p2, k3], SIZE, "brown")


@settings(max_examples=60)
@given(strong_cameras(), st.integers(0, 2**32 - 1))
def test_the_inverse_is_exact_inside_the_valid_radius(lens, seed):
    """A pixel is restored for ideal points inside the valid radius, up to a thousandth of it."""
    rng = np.random.default_rng(seed)
    corner = np.hypot(*SIZE) / min(lens.fx, lens.fy)
    limit = min(lens.valid_radius or math.inf, corner)
    radius = limit * np.append(np.sqrt(rng.random(300)), [0.99, 0.999, 0.0])
    angle = rng.uniform(0, 2 * np.pi, len(radius))
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    rays = np.column_stack([x, y, np.ones(len(radius))])
    pixels = lens.project(rays)
    # Coordinates far outside a picture have fewer decimals.
    rounding = 1e-9 * np.maximum(1.0, np.abs(pixels).max(axis=1) / 1e4)
    ideal = lens.undistort_points(pixels)
    assert (np.abs(lens.distort_points(ideal) - pixels).max(axis=1) < rounding).all()
    assert (np.abs(lens.project(lens.unproject(pixels)) - pixels).max(axis=1) < rounding).all()
    # The round trip is as exact as the distortion's slope allows; at the valid radius the slope is
    # zero.
    focal = np.array([lens.fx, lens.fy])
    expected = rays[:, :2] * focal + [lens.cx, lens.cy]
    slope = smallest_slope(lens, rays[:, :2])
    assert (np.abs(ideal - expected).max(axis=1) < rounding / np.minimum(slope, 1.0)).all()
    assert np.abs(ideal - expected)[slope > 0.5].max(initial=0.0) < 2e-9


def smallest_slope(lens, ideal):
    """Smallest singular value of the distortion's Jacobian, by central differences."""
    step = 1e-4 * lens.valid_radius if lens.valid_radius else 1e-4
    ideal = ideal * (1.0 - 1e-3)
    columns = []
    for shift in step * np.eye(2):
        ends = [
            lens.project(np.column_stack([ideal + sign * shift, np.ones(len(ideal))]))
            for sign in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step * np.array([lens.fx, lens.fy])))
    return np.linalg.svd(np.stack(columns, axis=-1), compute_uv=False)[:, 1]


@pytest.mark.parametrize(
    ("coefficients", "model"),
    [
        ((0, 0, 0, 0, 0), "radial2"),
        ((-0.3, 0.1, 0, 0, 0), "radial2"),
        ((-0.3, 0.1, 0, 0, 0.02), "radial3"),
        ((-0.3, 0.1, 0, 1e-3, 0), "brown"),
        ((-0.3, 0.1, 0, 0, 0, 0, 0, 0), "radial2"),
        ((-0.3, 0.1, 0, 0, 0, 0, 0.01, 0), "rational"),
        ((-0.3, 0.1, 0, 0, 0, 0, 0, 0, 1e-3, 0, 0, 0), "brown_prism"),
        ((-0.3, 0.1, 0, 0, 0, 0.01, 0, 0, 1e-3, 0, 0, 0), "thin_prism"),
        ((-0.3, 0.1, 0, 0, 0, 0.01, 0, 0, 0, 0, 0, 0, 0, 0), "rational"),
        ((-0.3, 0.1, 0, 0, 0, 0.01, 0, 0, 0, 0, 0, 1e-3, 0, 0), "thin_prism"),
    ],
)
@pytest.mark.parametrize("shape", [(-1,), (1, -1), (-1, 1)])
def test_opencv_s_coefficients_tell_the_model(coefficients, model, shape):
    given = np.array(coefficients, dtype=float).reshape(shape)
    lens = Camera(K, given, SIZE)
    assert lens.model == model
    points = np.array([[0.1, 0.2, 1.0], [-0.3, 0.1, 1.0]])
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, given.ravel())[0]
    assert np.abs(lens.project(points) - seen[:, 0]).max() < 1e-9
    again = Camera(K, lens.distortion, SIZE, model)
    assert again == lens


@pytest.mark.parametrize(
    ("distortion", "model", "message"),
    [
        ([0.0] * 4, None, r"5, 8, 12, 14 coefficients .*, not 4: append a 0 for k3.*\"fisheye\""),
        ([0.0] * 4, "brown", r"shape \(5\), not \(4,\).* append a 0 for k3"),
        (
            [0.0] * 14,
            "radial2",
            r"k1, k2, p1, p2, k3; without model= the number of coefficients determines the model",
        ),
        ([0.0] * 7, None, r"not 7$"),
        ([0.0] * 12 + [0.01, 0.0], None, r"tilts the sensor \(tx, ty \[0\.01, 0\.0\]\)"),
    ],
)
def test_coefficients_that_no_model_or_another_one_has_are_refused(distortion, model, message):
    with pytest.raises(ValueError, match=message):
        Camera(K, distortion, SIZE, *([model] if model else []))
