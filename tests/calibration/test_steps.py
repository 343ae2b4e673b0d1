"""The paper's steps one by one, against the truth and against OpenCV."""

import pickle

import cv2
import numpy as np
import pytest
from scenes import IMAGE_SIZE, squares

import trisquare as ts
from trisquare import simulate

CENTRE = np.array([639.5, 479.5])
HALF_DIAGONAL = 800.0
UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
SQUARE_LINES = np.array([[0, 1, 0.5], [1, 0, -0.5], [0, 1, -0.5], [1, 0, 0.5]])


def pinhole(seed=0):
    return squares(seed, simulate.TrueCamera(1010.0, 1006.0, 652.0, 471.0))


def homography_of(scene, number):
    target = scene.targets[number]
    return scene.camera.K @ np.column_stack([target.rotation[:, :2], target.translation])


def same_homography(found, expected, relative=1e-9):
    found, expected = (H / np.linalg.norm(H) for H in (found, expected))
    error = min(np.abs(found - expected).max(), np.abs(found + expected).max())
    return error < relative


# Step 1: straight lines.


def bent_lines(coefficients, centre=CENTRE, count=8, seed=1):
    """Curves that a straightening with exactly these coefficients makes straight."""
    rng = np.random.default_rng(seed)
    curves = []
    for _ in range(count):
        ends = rng.uniform([60, 60], [1220, 900], (2, 2))
        ideal = ends[0] + np.linspace(0, 1, 60)[:, None] * (ends[1] - ends[0]) - centre
        radius = np.hypot(*ideal.T)
        observed = radius.copy()
        for _ in range(200):  # the inverse of a gentle polynomial, by iteration
            rho2 = (observed / HALF_DIAGONAL) ** 2
            observed = radius / (1 + sum(a * rho2 ** (i + 1) for i, a in enumerate(coefficients)))
        curves.append(centre + ideal * (observed / radius)[:, None])
    return curves


@pytest.mark.parametrize("coefficients", [[0.12], [-0.08], [0.1, 0.03], [0.08, -0.02, 0.03]])
def test_a_known_polynomial_is_found(coefficients):
    curves = bent_lines(coefficients)
    found = ts.fit_distortion(curves, IMAGE_SIZE, len(coefficients), CENTRE)
    np.testing.assert_allclose(found.coefficients, coefficients, atol=1e-7)
    assert found.radius == HALF_DIAGONAL
    assert found.rms < 1e-7
    for curve in curves:
        straight = found.undistort(curve)
        spread = np.linalg.svd(straight - straight.mean(axis=0), compute_uv=False)
        assert spread[1] < 1e-6


def test_the_centre_is_found_where_the_curves_tell_it():
    centre = np.array([655.0, 470.0])
    found = ts.fit_distortion(bent_lines([0.15, 0.02], centre, count=20), IMAGE_SIZE)
    np.testing.assert_allclose(found.centre, centre, atol=1e-4)


def test_without_distortion_the_centre_stays_in_the_middle():
    curves = bent_lines([0.0])
    rng = np.random.default_rng(2)
    found = ts.fit_distortion([c + rng.normal(0, 0.1, c.shape) for c in curves], IMAGE_SIZE)
    np.testing.assert_array_equal(found.centre, CENTRE)
    assert np.abs(found.undistort(curves[0]) - curves[0]).max() < 0.5
    # Only the noise across a line counts, less the part fitted by its two parameters.
    assert found.rms == pytest.approx(0.1, rel=0.1)


def test_opencv_undistorts_alike():
    """The maps differ by a scale, undetermined by straightness, and by their polynomials."""
    camera = simulate.TrueCamera(1000.0, 1000.0, *CENTRE, [-0.2, 0.05, 0, 0, 0])
    sides = [
        side
        for sides in simulate.edge_points(squares(3, camera), np.random.default_rng(0), noise=0.0)
        for side in sides
    ]
    found = ts.fit_distortion(sides, IMAGE_SIZE, 3, CENTRE)
    points = np.vstack(sides)
    ours = found.undistort(points) - CENTRE
    opencv = cv2.undistortPoints(points[:, None], camera.K, camera.distortion, P=camera.K)[:, 0]
    opencv = opencv - CENTRE
    scale = (ours * opencv).sum() / (ours * ours).sum()
    assert np.abs(scale * ours - opencv).max() < 0.1
    assert np.abs(opencv - (points - CENTRE)).max() > 10


def test_a_straightening_is_a_value():
    found = ts.fit_distortion(bent_lines([0.12]), IMAGE_SIZE, 1)
    again = pickle.loads(pickle.dumps(found))
    assert repr(again) == repr(found)
    assert not again.coefficients.flags.writeable
    with pytest.raises(AttributeError):
        found.rms = 0.0


def test_beyond_the_invertible_radius_nothing_is_straightened():
    found = ts.fit_distortion(bent_lines([-0.15]), IMAGE_SIZE, 1, CENTRE)
    with pytest.raises(ValueError, match="beyond the radius"):
        found.undistort([[5000.0, 5000.0]])


# Step 2: homographies.


def meetings(lines):
    points = np.cross(np.roll(lines, 1, axis=0), lines)
    return points[:, :2] / points[:, 2:]


def test_four_lines_give_opencv_s_homography():
    scene = pinhole()
    for number in range(3):
        corners = scene.image_points(number, UNIT_SQUARE)
        ends = np.column_stack([corners, np.ones(4)])
        image_lines = np.cross(ends, np.roll(ends, -1, axis=0))
        found = ts.homography_from_lines(SQUARE_LINES, image_lines)
        opencv, _ = cv2.findHomography(meetings(SQUARE_LINES), meetings(image_lines))
        assert same_homography(found, opencv, 1e-6)  # OpenCV keeps points in float32
        assert same_homography(found, homography_of(scene, number))
        assert np.linalg.norm(found) == pytest.approx(1)


@pytest.mark.parametrize("scale", [1.0, -3.0, 1e-6, 1e6])
def test_the_scale_and_sign_of_lines_do_not_matter(scale):
    H = homography_of(pinhole(), 1)
    rng = np.random.default_rng(3)
    plane_lines = rng.normal(size=(9, 3))
    image_lines = plane_lines @ np.linalg.inv(H) * rng.choice([scale, 1.0], (9, 1))
    assert same_homography(ts.homography_from_lines(plane_lines, image_lines), H)


def test_lines_through_the_pixel_origin_do_no_harm():
    H = np.diag([100.0, 100.0, 1.0])
    assert same_homography(
        ts.homography_from_lines(SQUARE_LINES, SQUARE_LINES @ np.linalg.inv(H)), H
    )
    through = np.array([[0.0, 1, 0], [1, 0, 0], [1, 1, -1], [1, -2, 3]])
    assert same_homography(ts.homography_from_lines(through, through @ np.linalg.inv(H)), H)


# Step 3: the camera matrix.


@pytest.mark.parametrize("count", [2, 3, 6])
def test_the_camera_matrix_is_that_of_the_planes(count):
    rng = np.random.default_rng(4)
    for seed in range(4):
        camera = simulate.TrueCamera(1010.0, 1006.0, 652.0, 471.0)
        scene = squares(seed, camera, count=count)
        homographies = [homography_of(scene, i) * rng.normal() for i in range(count)]
        K = ts.camera_matrix_from_homographies(homographies)
        np.testing.assert_allclose(K, camera.K, rtol=1e-8, atol=1e-8 * camera.fx)
        assert (K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2]) == (0, 0, 0, 0, 1)


# Step 4: poses.


def test_opencv_finds_the_same_pose():
    scene = pinhole(5)
    K = scene.camera.K
    for number in range(3):
        rotation, translation = ts.pose_from_homography(K, -2.5 * homography_of(scene, number))
        _, vector, shift = cv2.solvePnP(
            np.column_stack([UNIT_SQUARE, np.zeros(4)]),
            scene.image_points(number, UNIT_SQUARE),
            K,
            None,
            flags=cv2.SOLVEPNP_IPPE,
        )
        np.testing.assert_allclose(rotation, cv2.Rodrigues(vector)[0], atol=1e-6)
        np.testing.assert_allclose(translation, shift[:, 0], atol=1e-5)
        np.testing.assert_allclose(rotation, scene.targets[number].rotation, atol=1e-9)
        np.testing.assert_allclose(translation, scene.targets[number].translation, atol=1e-9)


def test_a_noisy_homography_has_the_nearest_rotation():
    scene = pinhole(6)
    rng = np.random.default_rng(6)
    H = homography_of(scene, 0)
    rotation, _ = ts.pose_from_homography(scene.camera.K, H * (1 + 1e-3 * rng.normal(size=(3, 3))))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.abs(rotation - scene.targets[0].rotation).max() < 0.05


# Refusals.


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: ts.fit_distortion([], IMAGE_SIZE), ts.NotEnoughDataError, None),
        (lambda: ts.fit_distortion([[[0, 0]]], IMAGE_SIZE), ts.NotEnoughDataError, None),
        (lambda: ts.fit_distortion([[[0, 0, 0]] * 5], IMAGE_SIZE), ValueError, "curve 0"),
        (lambda: ts.fit_distortion([[[0, np.nan]] * 5], IMAGE_SIZE), ValueError, "0.*: leave out"),
        (lambda: ts.fit_distortion([[["a", "b"]] * 5], IMAGE_SIZE), TypeError, "curve 0"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), (0, 960)), ValueError, "image_size"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), (1e3, 960)), TypeError, "image_size"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), IMAGE_SIZE, 0), ValueError, "coefficients"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), IMAGE_SIZE, 4), ValueError, "coefficients"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), IMAGE_SIZE, 1.5), TypeError, "coefficients"),
        (lambda: ts.fit_distortion(bent_lines([0.1]), IMAGE_SIZE, 1, [1]), ValueError, "centre"),
        (
            lambda: ts.homography_from_lines(SQUARE_LINES[:3], SQUARE_LINES[:3]),
            ts.NotEnoughDataError,
            "line",
        ),
        (lambda: ts.homography_from_lines(SQUARE_LINES, SQUARE_LINES[:3]), ValueError, None),
        (lambda: ts.homography_from_lines(SQUARE_LINES[:, :2], SQUARE_LINES), ValueError, "plane"),
        (
            lambda: ts.homography_from_lines(SQUARE_LINES, SQUARE_LINES + np.inf),
            ValueError,
            "image",
        ),
        (lambda: ts.homography_from_lines(SQUARE_LINES, SQUARE_LINES * 1j), TypeError, "image"),
        (
            lambda: ts.homography_from_lines(SQUARE_LINES, np.ones((4, 3))),
            ts.DegenerateGeometryError,
            None,
        ),
        (lambda: ts.camera_matrix_from_homographies([]), ts.NotEnoughPlanesError, None),
        (lambda: ts.camera_matrix_from_homographies([np.eye(3)]), ts.NotEnoughPlanesError, None),
        (
            lambda: ts.camera_matrix_from_homographies([np.eye(3)] * 3),
            ts.DegenerateGeometryError,
            None,
        ),
        (lambda: ts.camera_matrix_from_homographies([np.eye(2)] * 3), ValueError, "homographies"),
        (
            lambda: ts.pose_from_homography(np.eye(3), np.zeros((3, 3))),
            ts.DegenerateGeometryError,
            None,
        ),
        (
            lambda: ts.pose_from_homography(np.zeros((3, 3)), np.eye(3)),
            ts.DegenerateGeometryError,
            None,
        ),
        (lambda: ts.pose_from_homography(np.eye(4), np.eye(3)), ValueError, "K"),
    ],
)
def test_each_step_refuses_what_it_cannot_answer(call, error, message):
    with pytest.raises(error, match=message):
        call()
