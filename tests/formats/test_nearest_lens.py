"""Lenses that a camera or a format cannot represent, and the nearest that it can."""

import pickle

import cv2
import numpy as np
import pytest
from camera_files import opencv_storage
from random_cameras import SIZE, assert_same, pixel_grid, random_camera

import trisquare as ts
from trisquare import Camera
from trisquare.formats import load_camera
from trisquare.formats.approximation import Family, nearest


def test_a_lens_that_a_camera_cannot_be_is_refused_with_the_nearest(tmp_path):
    camera = random_camera(7)
    dist = np.zeros(14)
    dist[:8] = 0.2, 0.1, 0.001, -0.001, 0.02, 0.35, 0.12, 0.01
    dist[12:] = 0.01, -0.02
    opencv_storage(
        tmp_path / "c.yml",
        **{"image_width": SIZE[0], "image_height": SIZE[1]},
        camera_matrix=np.array(camera.K),
        distortion_coefficients=dist,
    )
    with pytest.raises(ts.LensModelError, match=r"c\.yml: OpenCV's tilted.*px at worst") as info:
        Camera.load(tmp_path / "c.yml")
    loaded = load_camera(tmp_path / "c.yml", approximate=True)
    error = info.value
    assert_same(error.nearest, loaded.camera)
    assert (loaded.approximation.rms, loaded.approximation.worst) == (error.rms, error.worst)
    assert f"{error.rms:.3g} px rms, {error.worst:.3g} px" in str(error)
    # The stated error agrees with that computed by OpenCV.
    points = np.column_stack(
        [np.random.default_rng(1).uniform(-0.6, 0.6, (4000, 2)), np.ones(4000)]
    )
    none = np.zeros(3)
    seen = cv2.projectPoints(points, none, none, np.array(camera.K), dist)[0].reshape(-1, 2)
    inside = np.all((seen >= 0) & (seen <= np.array(SIZE) - 1), axis=1)
    off = np.linalg.norm(loaded.camera.project(points[inside]) - seen[inside], axis=1)
    assert 0.5 * error.rms < np.sqrt(np.mean(off**2)) < 1.2 * error.rms
    assert 0.5 * error.worst < off.max() < 1.01 * error.worst


def test_the_nearest_lens_is_the_least_squares_one(tmp_path):
    optimize = pytest.importorskip("scipy.optimize")
    camera = random_camera(8)
    pixels = pixel_grid(camera)
    family = Family("radtan", ("k1", "k2", "p1", "p2"))
    found = nearest(camera, family)
    # On the grid of the fit, with a spacing of a fortieth of the width.
    x, y = np.linspace(0, 1279, 41), np.linspace(0, 959, 31)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = camera.unproject(pixels)

    def residual(p):
        dist = np.array([*p[4:], 0.0])
        K = np.array([[p[0], 0, p[2]], [0, p[1], p[3]], [0, 0, 1]])
        none = np.zeros(3)
        return (cv2.projectPoints(rays, none, none, K, dist)[0].reshape(-1, 2) - pixels).ravel()

    k1, k2, p1, p2, _ = camera.distortion
    start = [camera.fx, camera.fy, camera.cx, camera.cy, k1, k2, p1, p2]
    best = optimize.least_squares(residual, start, x_scale="jac", xtol=1e-14, ftol=1e-14)
    assert found.rms == pytest.approx(np.sqrt(2 * np.mean(best.fun**2)), rel=1e-6)
    np.testing.assert_allclose(found.lens.distortion[:4], best.x[4:], atol=1e-7)
    assert found.lens.distortion[4] == 0


def test_where_the_lens_itself_has_no_direction_nothing_is_fitted(tmp_path):
    # Invertible up to a radius of 0.816, which is seen at 0.544: 544 of the 800 px to the corner.
    K = np.array([[1000.0, 0, 639.5], [0, 1000, 479.5], [0, 0, 1]])
    folded = Camera(K, [-0.5, 0, 0, 0, 1e-9], SIZE, "radial3")
    with pytest.raises(ts.LensModelError, match=r"of the \d\d % of the picture that have") as info:
        folded.save(tmp_path / "camchain.yaml")
    inside = np.hypot(*(pixel_grid(folded) - K[:2, 2]).T) < 500
    pixels = pixel_grid(folded)[inside]
    off = info.value.nearest.project(folded.unproject(pixels)) - pixels
    assert np.linalg.norm(off, axis=1).max() < info.value.worst + 1e-6 < 1e-3


def test_a_camera_that_kalibr_cannot_hold_is_written_only_if_asked(tmp_path):
    camera, path = random_camera(9), tmp_path / "camchain.yaml"
    with pytest.raises(ts.LensModelError, match=r"radtan.*px rms.*approximate=True") as info:
        camera.save(path)
    assert not path.exists()
    approximation = camera.save(path, approximate=True)
    read = Camera.load(path)
    assert read.distortion[4] == 0
    assert approximation.worst == info.value.worst > 0
    off = np.linalg.norm(
        read.project(camera.unproject(pixel_grid(camera))) - pixel_grid(camera), axis=1
    )
    assert off.max() == pytest.approx(approximation.worst, rel=0.05)
    # Only omitting k3 is worse.
    cut = Camera(camera.K, camera.distortion * [1, 1, 1, 1, 0], SIZE, "brown")
    cut_off = np.linalg.norm(
        cut.project(camera.unproject(pixel_grid(camera))) - pixel_grid(camera), axis=1
    )
    assert np.sqrt(np.mean(cut_off**2)) > 2 * approximation.rms


@pytest.mark.parametrize("approximate", [False, True])
def test_a_lens_that_no_model_of_a_format_comes_near_is_named_as_such(tmp_path, approximate):
    matrix = [[500.0, 0, 640], [0, 500, 480], [0, 0, 1]]
    camera = ts.Camera(matrix, [0.01, 0.001, 0, 0], (1280, 960), "fisheye")
    for name in ("a.cameramodel", "a.pto"):
        with pytest.raises(
            ts.LensModelError, match=r"cannot store this camera.*is near this lens"
        ) as info:
            camera.save(tmp_path / name, approximate=approximate)
        assert (info.value.nearest, info.value.rms) == (None, np.inf)
        assert pickle.loads(pickle.dumps(info.value)).worst == np.inf
    assert not list(tmp_path.iterdir())
