"""Cameras, scenes, edge points and the bound: checked by independent computations."""

from itertools import chain

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from trisquare import simulate
from trisquare.simulate import (
    chessboard_scene,
    cramer_rao_bound,
    edge_points,
    pixel_sigma,
    random_camera,
    random_scene,
)
from trisquare.simulate.scene import Scene, Target, TrueCamera, sample_sides

BROWN = TrueCamera(870.0, 874.0, 655.0, 470.0, np.array([-0.21, 0.08, 1.2e-3, -7e-4, -0.01]))
SEEDS = range(60)
FREE = ("fx", "fy", "cx", "cy", "k1", "k2")


def test_projection_matches_opencv():
    points = np.random.default_rng(1).uniform([-1.5, -1.2, 2.0], [1.5, 1.2, 5.0], (200, 3))
    wanted, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), BROWN.K, BROWN.distortion)
    np.testing.assert_allclose(BROWN.project(points), wanted.reshape(-1, 2), rtol=0, atol=1e-9)


def test_undistort_inverts_distort_over_the_picture():
    for camera in [BROWN, *(random_camera(np.random.default_rng(seed)) for seed in range(30))]:
        x, y = np.meshgrid(np.linspace(0, 1279, 33), np.linspace(0, 959, 25))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
        rays = np.column_stack([camera.undistort(pixels), np.ones(len(pixels))])
        np.testing.assert_allclose(camera.project(rays), pixels, rtol=0, atol=1e-9)


def test_undistort_refuses_a_pixel_beyond_the_lens():
    """With k1 = -0.3 no ideal radius maps beyond 0.703, where there is no result."""
    camera = TrueCamera(500.0, 500.0, 640.0, 480.0, np.array([-0.3, 0, 0, 0, 0]))
    assert not camera.is_monotonic()
    with pytest.raises(ValueError, match="beyond"):
        camera.undistort(np.array([[640.0 + 0.75 * 500.0, 480.0]]))


def test_random_cameras_follow_the_design():
    cameras = [random_camera(np.random.default_rng(seed)) for seed in range(300)]
    focal = np.array([camera.fx for camera in cameras]) / 1280
    assert focal.min() >= 0.65
    assert focal.max() <= 1.3
    assert abs(focal.mean() - 0.975) < 4 * 0.65 / np.sqrt(12 * 300)
    aspect = np.array([camera.fy / camera.fx for camera in cameras])
    assert np.abs(aspect - 1).max() <= 0.005
    centre = np.array([(camera.cx - 639.5, camera.cy - 479.5) for camera in cameras])
    assert centre.std() == pytest.approx(0.012 * 1280, rel=4 / np.sqrt(2 * 600))
    for camera in cameras:
        k1, k2, p1, p2, k3 = camera.distortion
        assert -0.32 <= k1 <= 0.12
        assert 0 <= k2 <= 0.35 * abs(k1)
        assert p1 == p2 == k3 == 0
        corners = np.array([[0.0, 0.0], [1279, 0], [1279, 959], [0, 959]])
        farthest = np.hypot(*camera.undistort(corners).T).max()
        radii = np.linspace(0.0, farthest, 1000)
        assert np.all(np.diff(radii * (1 + k1 * radii**2 + k2 * radii**4)) > 0)


def quadrilateral(scene, i, scale=1.0):
    return scene.image_points(i, scale * scene.targets[i].outlines()[0])


@pytest.mark.parametrize("kind", ["square", "frame"])
def test_random_scenes_follow_the_design(kind):
    for seed in SEEDS:
        scene = random_scene(np.random.default_rng(seed), kind=kind)
        assert len(scene.targets) == 3
        directions = []
        canvas = np.zeros((960, 1280), np.uint8)
        for i, target in enumerate(scene.targets):
            assert target.kind == kind
            np.testing.assert_allclose(target.rotation @ target.rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(target.rotation) == pytest.approx(1.0)
            normal = target.rotation[:, 2]
            assert 25.0 <= np.rad2deg(np.arccos(normal[2])) <= 50.0
            directions.append(np.rad2deg(np.arctan2(normal[1], normal[0])))
            side = scene.camera.fx / target.translation[2]
            assert 0.30 * 960 <= side <= 0.42 * 960
            corners = quadrilateral(scene, i)
            assert corners.min() > 12
            assert np.all(corners < [1267, 947])
            x, y = corners.T
            assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0, "not clockwise on screen"
            alone = np.zeros_like(canvas)
            grown = quadrilateral(scene, i, 1.1)
            cv2.fillPoly(alone, [np.rint(grown).astype(np.int32)], 1)
            canvas += alone
        assert canvas.max() == 1, "two squares overlap"
        apart = np.diff([*directions, directions[0]]) % 360.0
        assert np.all(np.abs(apart - 120.0) <= 40.0)


def test_more_and_fewer_squares_fit_too():
    for count in (1, 2, 4, 6):
        assert len(random_scene(np.random.default_rng(count), count=count).targets) == count


@pytest.mark.parametrize("count", [3, 6])
def test_sides_and_tilts_may_be_given(count):
    rng = np.random.default_rng(count)
    scene = random_scene(rng, count=count, sides=(0.15, 0.16), tilts=(30.0, 31.0))
    assert len(scene.targets) == count
    for target in scene.targets:
        side = scene.camera.fx / target.translation[2] / scene.camera.image_size[1]
        assert 0.15 <= side <= 0.16
        assert 30.0 <= np.degrees(np.arccos(target.rotation[2, 2])) <= 31.0


def test_squares_that_do_not_fit_are_refused(monkeypatch):
    monkeypatch.setattr("trisquare.simulate.scenes.MAX_DRAWS", 100)
    with pytest.raises(ValueError, match="no 3 squares fit"):
        random_scene(np.random.default_rng(0), sides=(2.0, 2.0))


def test_chessboard_session_fills_the_pictures():
    rng = np.random.default_rng(3)
    camera = random_camera(rng)
    areas, normals = [], []
    for _ in range(20):
        scene = chessboard_scene(rng, camera)
        corners = quadrilateral(scene, 0)
        assert corners.min() > 12
        assert np.all(corners < [1267, 947])
        areas.append(cv2.contourArea(corners.astype(np.float32)) / (1280 * 960))
        normals.append(scene.targets[0].rotation[:, 2])
        assert scene.targets[0].board_corners().shape == (54, 2)
    assert np.median(areas) > 0.15
    assert np.ptp(np.array(normals)[:, :2], axis=0).min() > 0.4


def test_same_seed_same_scene_and_points():
    def draw(seed):
        rng = np.random.default_rng(seed)
        return list(chain.from_iterable(edge_points(random_scene(rng), rng, noise=0.1)))

    first, second, third = draw(5), draw(5), draw(6)
    for one, two, other in zip(first, second, third, strict=True):
        np.testing.assert_array_equal(one, two)
        assert one.shape != other.shape or np.any(one != other)


@pytest.mark.parametrize("kind", ["square", "frame"])
def test_edge_points_lie_on_their_sides(kind):
    """Undistorted and mapped back to the plane, side i is on its line between its corners."""
    rng = np.random.default_rng(7)
    scene = random_scene(rng, kind=kind)
    for target, sides in zip(scene.targets, edge_points(scene, rng, noise=0.0), strict=True):
        assert len(sides) == (8 if kind == "frame" else 4)
        ray_from_plane = np.column_stack([target.rotation[:, :2], target.translation])
        for i, points in enumerate(sides):
            half = 0.5 if i < 4 else 0.5 * target.inner
            rays = np.column_stack([scene.camera.undistort(points), np.ones(len(points))])
            plane = rays @ np.linalg.inv(ray_from_plane).T
            x, y = (plane[:, :2] / plane[:, 2:]).T
            across, along = [(-y, x), (x, y), (y, -x), (-x, -y)][i % 4]
            np.testing.assert_allclose(across, half, rtol=0, atol=1e-10)
            assert np.all(np.diff(along) > 0)
            assert np.all(np.abs(along) < half)
            gaps = np.hypot(*np.diff(points, axis=0).T)
            np.testing.assert_allclose(gaps, gaps.mean(), rtol=1e-3)
            assert 4.0 <= gaps.mean() < 4.3


def test_edge_noise_is_along_the_normal_with_the_stated_spread():
    scene = random_scene(np.random.default_rng(8))
    clean = edge_points(scene, np.random.default_rng(9), noise=0.0, spacing=0.5)
    noisy = edge_points(scene, np.random.default_rng(9), noise=0.3, spacing=0.5)
    across, along = [], []
    for target, before, after in zip(scene.targets, clean, noisy, strict=True):
        sides = sample_sides(scene.camera, target, 0.5)
        for side, one, two in zip(sides, before, after, strict=True):
            across.append(np.sum((two - one) * side.normal, axis=1))
            along.append((two - one) @ [[0, 1], [-1, 0]] * side.normal)
    across = np.concatenate(across)
    assert across.std() == pytest.approx(0.3, rel=4 / np.sqrt(2 * across.size))
    assert abs(across.mean()) < 4 * 0.3 / np.sqrt(across.size)
    assert np.abs(np.concatenate(along).sum(axis=1)).max() < 1e-9


def test_pixel_sigma_matches_the_information_of_sampled_pixels():
    """Sum, over pixels across an edge, the information of each about the edge's offset."""
    noise, contrast, blur = 2.0, 175.0, 0.8
    spread = np.sqrt(blur**2 + 1 / 12)
    offsets = np.arange(-30, 31) + 0.3
    slope = contrast * np.exp(-0.5 * (offsets / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
    wanted = noise / np.sqrt(np.sum(slope**2))
    assert pixel_sigma(noise, contrast, blur) == pytest.approx(wanted, rel=1e-3)


def test_bound_scales_with_noise_and_number_of_points():
    scene = random_scene(np.random.default_rng(10))
    base = cramer_rao_bound(scene, 0.1)
    assert tuple(base) == FREE
    double = cramer_rao_bound(scene, 0.2)
    sparse = cramer_rao_bound(scene, 0.1, spacing=4.0)
    for name in FREE:
        assert double[name] == pytest.approx(2 * base[name], rel=1e-9)
        assert sparse[name] == pytest.approx(2 * base[name], rel=1e-3)


def test_knowing_more_never_hurts():
    scene = random_scene(np.random.default_rng(11))
    everything = cramer_rao_bound(scene, 0.1, free=(*FREE, "p1", "p2", "k3"))
    usual = cramer_rao_bound(scene, 0.1)
    one_focal = cramer_rao_bound(scene, 0.1, free=("f", "cx", "cy", "k1", "k2"))
    centred = cramer_rao_bound(scene, 0.1, free=("f", "k1", "k2"))
    assert all(everything[name] > usual[name] for name in FREE)
    assert centred["f"] < one_focal["f"] < min(usual["fx"], usual["fy"])


def test_frames_beat_squares():
    squares = random_scene(np.random.default_rng(12))
    frames = Scene(
        squares.camera,
        tuple(Target(t.rotation, t.translation, "frame") for t in squares.targets),
    )
    plain, framed = cramer_rao_bound(squares, 0.1), cramer_rao_bound(frames, 0.1)
    assert all(framed[name] < plain[name] for name in FREE)


def test_parallel_squares_have_no_bound():
    pose = simulate.tilted(30.0, 0.0, 10.0)
    places = ([-1.0, -0.5, 4.0], [1.0, -0.5, 4.5], [0.0, 0.8, 4.2])
    camera = TrueCamera(1000.0, 1000.0, 640.0, 480.0)
    scene = Scene(camera, tuple(Target(pose, np.array(place)) for place in places))
    with pytest.raises(ValueError, match="determine"):
        cramer_rao_bound(scene, 0.1, free=("fx", "fy", "cx", "cy"))
    cramer_rao_bound(scene, 0.1, free=("f",))


FIT_SPACING = 16.0


def fit(scene, observed):
    """Maximum likelihood with SciPy and OpenCV's projection.

    The position of a point along its side does not change its offset across it, so that the true
    position can be used.
    """
    camera = scene.camera
    sides = [sample_sides(camera, target, FIT_SPACING) for target in scene.targets]
    plane = [np.concatenate([side.plane for side in of_target]) for of_target in sides]
    normals = np.concatenate([side.normal for of_target in sides for side in of_target])
    measured = np.concatenate([points for of_target in observed for points in of_target])
    in_hole = [np.abs(points).max(axis=1) < 0.499 for points in plane]
    start = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion[:2]]
    for target in scene.targets:
        start += [*Rotation.from_matrix(target.rotation).as_rotvec(), *target.translation]
    start += [target.inner for target in scene.targets if target.kind == "frame"]
    scale = np.ones(len(start))
    scale[:6] = [1e3, 1e3, 1e3, 1e3, 0.1, 0.1]

    def residuals(scaled):
        parameters = scaled * scale
        fx, fy, cx, cy, k1, k2 = parameters[:6]
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        holes = parameters[24:] / scene.targets[0].inner
        projected = []
        for i, points in enumerate(plane):
            turn, shift = parameters[6 + 6 * i : 12 + 6 * i].reshape(2, 3)
            sizes = np.where(in_hole[i], holes[i] if holes.size else 1.0, 1.0)
            space = np.column_stack([points * sizes[:, None], np.zeros(len(points))])
            image, _ = cv2.projectPoints(space, turn, shift, K, np.array([k1, k2, 0, 0, 0]))
            projected.append(image.reshape(-1, 2))
        return np.sum((np.concatenate(projected) - measured) * normals, axis=1)

    solution = least_squares(residuals, np.array(start) / scale, method="lm", xtol=1e-12)
    return (solution.x * scale)[:6]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["square", "frame"])
def test_bound_is_what_maximum_likelihood_reaches(kind):
    """The fit's errors over many noisy measurements of a scene have the bound's spread."""
    draws = 60
    rng = np.random.default_rng(13)
    scene = random_scene(rng, kind=kind)
    bound = cramer_rao_bound(scene, 0.05, spacing=FIT_SPACING)
    truth = np.array([*scene.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], *scene.camera.distortion[:2]])
    fits = [
        fit(scene, edge_points(scene, rng, noise=0.05, spacing=FIT_SPACING)) for _ in range(draws)
    ]
    ratio = (np.array(fits) - truth) / [bound[name] for name in FREE]
    # A mean square of N normal errors has a standard deviation of sqrt(2 / N) about its mean of 1.
    assert np.abs(np.mean(ratio**2, axis=0) - 1.0).max() < 4 * np.sqrt(2 / draws)
    assert np.abs(ratio.mean(axis=0)).max() < 4 / np.sqrt(draws)
    # All six together have a smaller scatter than one of them.
    assert np.mean(ratio**2) == pytest.approx(1.0, abs=3 * np.sqrt(2 / draws))
