"""Cameras in the formats of other programs, read by those themselves where they are here."""

import io
import json
import pickle
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from camera_files import FILES, PANORAMA
from scenes import edges_of, squares

import trisquare as ts
from trisquare import Camera
from trisquare.formats import FORMAT_NAMES, load_camera
from trisquare.formats.approximation import Family, nearest

SIZE = (1280, 960)
MODELS = {
    "none": (),
    "radial1": (0,),
    "radial2": (0, 1),
    "radial3": (0, 1, 4),
    "brown": (0, 1, 2, 3, 4),
}
DEBIAN_PYTHON = Path("/usr/bin/python3")


def random_camera(seed, coefficients="brown", **changes):
    """A camera with numbers of 16 digits, invertible over the whole picture."""
    rng = np.random.default_rng(seed)
    fx = rng.uniform(900, 1500)
    K = np.array([[fx, 0, rng.normal(640, 15)], [0, fx * rng.uniform(0.99, 1.01), 0], [0, 0, 1]])
    K[1, 2] = rng.normal(480, 15)
    spread = np.array([0.1, 0.03, 0.002, 0.002, 0.01])
    distortion = np.zeros(5)
    for index in MODELS[coefficients]:
        distortion[index] = spread[index] * rng.uniform(-1, 1)
    values = {"K": K, "distortion": distortion, "image_size": SIZE, "model": coefficients}
    return Camera(**{**values, **changes})


def pixel_grid(camera):
    width, height = camera.image_size
    x, y = np.linspace(0, width - 1, 15), np.linspace(0, height - 1, 11)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def saved(camera, path):
    approximation = camera.save(path, FILES[path.name])
    assert approximation is None
    return path


def assert_same(read, camera, tolerance=0.0, distortion_tolerance=0.0):
    assert read.image_size == camera.image_size
    assert np.abs(read.K - camera.K).max() <= tolerance
    assert np.abs(read.distortion - camera.distortion).max() <= distortion_tolerance


def camera_for_hugin(seed, coefficients):
    """One with square pixels and no more than k1."""
    camera = random_camera(seed, coefficients)
    K = camera.K.copy()
    K[1, 1] = K[0, 0]
    return Camera(K, camera.distortion * [1, 0, 0, 0, 0], SIZE, coefficients)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("model", MODELS)
def test_what_is_written_is_read_back(tmp_path, name, model):
    for seed in range(5):
        camera = random_camera(100 * seed + len(model), model)
        if FILES[name] == "kalibr":
            camera = random_camera(seed, model, distortion=camera.distortion * [1, 1, 1, 1, 0])
        if FILES[name] in PANORAMA:
            camera = camera_for_hugin(100 * seed + len(model), model)
        size = SIZE if FILES[name] == "lensfun" else None
        read = load_camera(saved(camera, tmp_path / name), image_size=size)
        assert (read.format, read.approximation) == (FILES[name], None)
        # Moving the origin of a principal point by half a pixel may round its last digit.
        shifted = FILES[name] in ("colmap", "nerfstudio")
        if FILES[name] in PANORAMA:  # whose numbers are others, of which ours are computed
            assert_same(read.camera, camera, tolerance=1e-12, distortion_tolerance=1e-15)
        else:
            assert_same(read.camera, camera, tolerance=2.3e-13 if shifted else 0.0)
        again = Camera.load(tmp_path / name, format=FILES[name], image_size=size)
        assert_same(again, read.camera)


def test_trisquares_own_file_keeps_model_and_valid_radius(tmp_path):
    camera = random_camera(3, "radial2", model="brown", valid_radius=0.9)
    camera.save(tmp_path / "camera.json")
    read = Camera.load(tmp_path / "camera.json")
    assert (read.model, read.valid_radius) == ("brown", 0.9)
    unlimited = random_camera(3, "none")
    unlimited.save(tmp_path / "camera.json")
    assert Camera.load(tmp_path / "camera.json").valid_radius is None


def test_a_camera_goes_through_text_without_a_file(tmp_path):
    camera = random_camera(5, "brown", valid_radius=0.9)
    camera.save(tmp_path / "camera.json")
    assert camera.to_json() == (tmp_path / "camera.json").read_text()
    assert Camera.from_json(camera.to_json()) == camera
    with pytest.raises(ValueError, match='"format" must be'):
        Camera.from_json(camera.to_json().replace("trisquare-camera", "another"))


def test_a_calibration_is_read_as_its_camera(tmp_path):
    camera = random_camera(4, "radial2")
    result = ts.Calibration(
        **{"camera": camera, "std": {}, "covariance": np.empty((0, 0)), "parameters": ()},
        **{"planes": (), "rms": 0.1, "noise_scale": 1.0, "warnings": (), "method": "ml"},
        **{"tone": None, "fixed": (), "stage": "edges"},
    )
    (tmp_path / "result.json").write_text(result.to_json())
    assert_same(Camera.load(tmp_path / "result.json"), camera)
    assert_same(Camera.from_json(result.to_json()), camera)


def opencv_storage(path, **members):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in members.items():
        storage.write(name, value)
    storage.release()


@pytest.mark.parametrize("name", ["camera.yaml", "camera.xml", "opencv.json"])
def test_opencv_itself_reads_and_writes_the_same(tmp_path, name):
    for seed in range(5):
        camera = random_camera(seed)
        storage = cv2.FileStorage(str(saved(camera, tmp_path / name)), cv2.FILE_STORAGE_READ)
        size = storage.getNode("image_width").real(), storage.getNode("image_height").real()
        assert size == SIZE
        np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), camera.K)
        dist = storage.getNode("distortion_coefficients").mat()
        np.testing.assert_array_equal(dist.ravel(), camera.distortion)
        storage.release()
        opencv_storage(
            tmp_path / name,
            calibration_time="Sat Nov 21 2026",
            image_width=SIZE[0],
            image_height=SIZE[1],
            flags=0,
            camera_matrix=np.array(camera.K),
            distortion_coefficients=camera.distortion.reshape(5, 1).copy(),
            avg_reprojection_error=0.25,
            image_points=np.arange(24.0, dtype=np.float32).reshape(3, 4, 2),
        )
        read = load_camera(tmp_path / name)
        assert read.format == "opencv"
        assert_same(read.camera, camera)


def test_opencv_files_without_a_size_need_it(tmp_path):
    camera, path = random_camera(5), tmp_path / "camera.yaml"
    opencv_storage(path, cameraMatrix=np.array(camera.K), distCoeffs=camera.distortion.copy())
    with pytest.raises(ValueError, match=r'camera\.yaml: "image_width".*missing.*image_size='):
        Camera.load(path)
    assert_same(Camera.load(path, image_size=SIZE), camera)
    with pytest.raises(ValueError, match="must be positive"):
        Camera.load(path, image_size=(0, 5))
    saved(camera, path)
    with pytest.raises(ValueError, match=r"\(1280, 960\) pixels, not \(640, 480\)"):
        Camera.load(path, image_size=(640, 480))


@pytest.mark.parametrize("length", [4, 5, 8, 12, 14])
def test_higher_coefficients_of_opencv_that_vanish_are_no_loss(tmp_path, length):
    camera = random_camera(6)
    dist = np.zeros(length)
    dist[:5] = camera.distortion[: min(length, 5)] if length > 4 else 0
    opencv_storage(
        tmp_path / "c.yml",
        **{"image_width": SIZE[0], "image_height": SIZE[1]},
        camera_matrix=np.array(camera.K),
        distortion_coefficients=dist,
    )
    assert_same(
        Camera.load(tmp_path / "c.yml"),
        Camera(camera.K, (*dist[:4], sum(dist[4:5])), SIZE, "brown"),
    )


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
    # What is said of the error is what OpenCV finds.
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
    # On the grid that the fit is over, spaced like a fortieth of the width.
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
    # Invertible up to 0.816, where it shows 0.544: 544 of the 800 px to the corner.
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
    # Leaving k3 out and the rest alone is worse.
    cut = Camera(camera.K, camera.distortion * [1, 1, 1, 1, 0], SIZE, "brown")
    cut_off = np.linalg.norm(
        cut.project(camera.unproject(pixel_grid(camera))) - pixel_grid(camera), axis=1
    )
    assert np.sqrt(np.mean(cut_off**2)) > 2 * approximation.rms


def test_ros_files_have_what_camera_info_manager_wants(tmp_path):
    camera = random_camera(10)
    members = yaml.safe_load(saved(camera, tmp_path / "camera_info.yaml").read_text())
    shapes = {
        "camera_matrix": (3, 3),
        "distortion_coefficients": (1, 5),
        "rectification_matrix": (3, 3),
        "projection_matrix": (3, 4),
    }
    assert set(members) == {
        *shapes,
        "image_width",
        "image_height",
        "camera_name",
        "distortion_model",
    }
    assert (members["image_width"], members["image_height"]) == SIZE
    assert members["distortion_model"] == "plumb_bob"
    matrices = {}
    for name, (rows, columns) in shapes.items():
        assert set(members[name]) == {"rows", "cols", "data"}
        assert (members[name]["rows"], members[name]["cols"]) == (rows, columns)
        assert all(type(value) is float for value in members[name]["data"])
        matrices[name] = np.reshape(members[name]["data"], (rows, columns))
    np.testing.assert_array_equal(matrices["camera_matrix"], camera.K)
    np.testing.assert_array_equal(matrices["distortion_coefficients"][0], camera.distortion)
    np.testing.assert_array_equal(matrices["rectification_matrix"], np.eye(3))
    np.testing.assert_array_equal(matrices["projection_matrix"], np.c_[camera.K, np.zeros(3)])


ROS_FILE = """\
image_width: 2448
image_height: 2050
camera_name: prosilica
camera_matrix:
  rows: 3
  cols: 3
  data: [4827.94, 0, 1223.5, 0, 4835.62, 1024.5, 0, 0, 1]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {length}
  data: [{data}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [4827.94, 0, 1223.5, 0, 0, 4835.62, 1024.5, 0, 0, 0, 1, 0]
"""


@pytest.mark.parametrize(
    ("model", "data", "distortion"),
    [
        (
            "plumb_bob",
            "-0.41527, 0.31874, -0.00197, 0.00071, 0",
            (-0.41527, 0.31874, -0.00197, 0.00071, 0),
        ),
        # As libraries in C++ write small numbers.
        ("plumb_bob", "1e-05, 0, 0, -2E-3, 0", (1e-05, 0, 0, -2e-3, 0)),
        ("rational_polynomial", "-0.1, 0, 0, 0, 0.02, 0, 0, 0", (-0.1, 0, 0, 0, 0.02)),
    ],
)
def test_ros_files_of_others_are_read(tmp_path, model, data, distortion):
    text = ROS_FILE.format(model=model, data=data, length=data.count(",") + 1)
    (tmp_path / "left.yaml").write_text(text)
    loaded = load_camera(tmp_path / "left.yaml")
    assert (loaded.format, loaded.name) == ("ros", "prosilica")
    camera = loaded.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (4827.94, 4835.62, 1223.5, 1024.5)
    assert camera.image_size == (2448, 2050)
    np.testing.assert_array_equal(camera.distortion, distortion)


KALIBR_FILE = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99, 0.0, 0.0, -0.11]
  - [0.0, 0.99, 0.0, 0.0]
  - [0.0, 0.0, 0.99, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.003, -0.002, 0.0005, -0.0001]
  distortion_model: equidistant
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


def test_a_chain_of_kalibrs_has_several_cameras(tmp_path):
    (tmp_path / "rig.yaml").write_text(KALIBR_FILE)
    with pytest.raises(ValueError, match=r"2 cameras, cam0, cam1: say which with name="):
        Camera.load(tmp_path / "rig.yaml")
    with pytest.raises(ValueError, match="no camera 'cam2', but cam0, cam1"):
        Camera.load(tmp_path / "rig.yaml", name="cam2")
    left = Camera.load(tmp_path / "rig.yaml", name="cam0")
    assert (left.fx, left.fy, left.cx, left.cy) == (458.654, 457.296, 367.215, 248.375)
    assert (left.image_size, left.model) == ((752, 480), "brown")
    np.testing.assert_array_equal(
        left.distortion, [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0]
    )
    right = Camera.load(tmp_path / "rig.yaml", name="cam1")
    assert (right.image_size, right.model) == ((752, 480), "fisheye")
    np.testing.assert_array_equal(right.distortion, [0.003, -0.002, 0.0005, -0.0001])
    # What stands in for a fisheye, measured with OpenCV's own.
    with pytest.raises(ts.LensModelError, match="cannot hold this camera") as info:
        right.save(tmp_path / "right.cameramodel")
    pixels = np.stack(np.meshgrid(np.linspace(0, 751, 15), np.linspace(0, 479, 11)), axis=-1)
    pixels = pixels.reshape(-1, 1, 2)
    ideal = cv2.fisheye.undistortPoints(pixels, right.K, right.distortion)
    seen = info.value.nearest.project(np.c_[ideal[:, 0], np.ones(len(ideal))])
    off = np.linalg.norm(seen - pixels[:, 0], axis=1)
    assert 0.7 * info.value.worst < off.max() < 1.02 * info.value.worst


@pytest.mark.parametrize("model", ["equidistant", "fisheye"])
@pytest.mark.parametrize(
    "name",
    [
        *("camera.json", "camera.yaml", "camera.xml", "camera_info.yaml", "camchain.yaml"),
        *("cameras.txt", "transforms.json"),
    ],
)
def test_a_fisheye_comes_back_exactly(tmp_path, name, model):
    distortion = [0.02, -0.01, 0.003, -0.0004] if model == "fisheye" else np.zeros(4)
    camera = Camera([[400.5, 0, 641.25], [0, 401, 480], [0, 0, 1]], distortion, SIZE, model)
    loaded = Camera.load(saved(camera, tmp_path / name))
    assert loaded.model == model
    np.testing.assert_array_equal(loaded.distortion, camera.distortion)
    np.testing.assert_allclose(loaded.K, camera.K, rtol=1e-15)


RICH = [0.2, 0.1, 0.001, -0.001, 0.02, 0.35, 0.12, 0.01]
PRISM = [1e-3, -2e-3, 3e-3, 1e-3]


@pytest.mark.parametrize(
    ("model", "distortion", "names"),
    [
        (
            "rational",
            RICH,
            "camera.json camera.yaml camera_info.yaml left.cameramodel cameras.txt",
        ),
        ("thin_prism", RICH + PRISM, "camera.json camera.xml camera_info.yaml left.cameramodel"),
        ("brown_prism", [*RICH[:5], 0, 0, 0, *PRISM], "camera.json camera.yaml left.cameramodel"),
    ],
)
def test_lenses_beyond_brown_s_come_back_exactly(tmp_path, model, distortion, names):
    camera = Camera([[900.5, 0, 641.25], [0, 901, 480], [0, 0, 1]], distortion, SIZE, model)
    points = np.array([[0.3, 0.2, 1.0], [-0.5, 0.1, 1.0]])
    seen, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.array(camera.K), np.array(distortion)
    )
    np.testing.assert_allclose(camera.project(points), seen[:, 0], atol=1e-9)
    for name in names.split():
        loaded = Camera.load(saved(camera, tmp_path / name))
        assert loaded.model == model
        np.testing.assert_array_equal(loaded.distortion, camera.distortion)
    with pytest.raises(ts.LensModelError, match="cannot hold this camera"):
        camera.save(tmp_path / "camchain.yaml")
    # OpenCV has no skew: the nearest of its lenses that can be fitted is named.
    skewed = Camera([[900.5, 1.5, 641.25], [0, 901, 480], [0, 0, 1]], distortion, SIZE, model)
    with pytest.raises(
        ts.LensModelError, match=r"skew 1\.5 px\); the nearest that it can is brown"
    ):
        skewed.save(tmp_path / "camera.yaml")


@pytest.mark.parametrize("distortion", [[0.02, 0, 0, 0], [0.02, -0.01, 0, 0], [0.1, 0.2, 0.3, 0.4]])
def test_colmap_itself_sees_a_fisheye_as_it_is(tmp_path, distortion):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    camera = Camera([[400, 0, 641], [0, 400, 480], [0, 0, 1]], distortion, SIZE, "fisheye")
    saved(camera, tmp_path / "cameras.txt")
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(tmp_path))
    rays = np.array([[0.1, 0.2], [-0.8, 0.3], [0.5, -0.6]])
    theirs = reconstruction.cameras[1].img_from_cam(np.c_[rays, np.ones(3)])
    np.testing.assert_allclose(camera.project(np.c_[rays, np.ones(3)]) + 0.5, theirs, atol=1e-9)


def test_kalibr_files_have_its_schema(tmp_path):
    camera = random_camera(11, "radial2")
    members = yaml.safe_load(saved(camera, tmp_path / "camchain.yaml").read_text())
    theirs = yaml.safe_load(KALIBR_FILE)["cam0"]
    assert set(members) == {"cam0"}
    assert set(members["cam0"]) == set(theirs)
    assert members["cam0"]["resolution"] == list(SIZE)
    assert (members["cam0"]["camera_model"], members["cam0"]["distortion_model"]) == (
        "pinhole",
        "radtan",
    )


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("square", [False, True])
def test_colmap_itself_sees_the_same(tmp_path, model, square):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    camera = random_camera(12, model)
    if square:
        K = camera.K.copy()
        K[1, 1] = K[0, 0]
        camera = random_camera(12, model, K=K)
    saved(camera, tmp_path / "cameras.txt")
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(tmp_path))
    theirs = reconstruction.cameras[1]
    wanted = {
        **{"none": "PINHOLE", "radial1": "OPENCV", "radial2": "OPENCV"},
        **{"radial3": "FULL_OPENCV", "brown": "FULL_OPENCV"},
    }
    simple = {"none": "SIMPLE_PINHOLE", "radial1": "SIMPLE_RADIAL", "radial2": "RADIAL"}
    assert theirs.model.name == (simple if square else {}).get(model, wanted[model])
    assert (theirs.width, theirs.height) == SIZE
    rays = camera.unproject(pixel_grid(camera))
    seen = theirs.img_from_cam(rays)
    # Its pixels are counted from the corner of the first one.
    assert np.abs(seen - 0.5 - pixel_grid(camera)).max() < 1e-9
    # What it writes itself is read.
    reconstruction.write_text(str(tmp_path))
    assert_same(Camera.load(tmp_path / "cameras.txt"), camera, tolerance=2.3e-13)


def test_colmaps_fisheye_with_thin_prisms_is_read_where_it_has_none(tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    path = tmp_path / "cameras.txt"
    model, numbers = (
        "THIN_PRISM_FISHEYE",
        [515, 516, 640, 480, 0.02, -0.01, 0, 0, 0.003, -4e-4, 0, 0],
    )
    theirs = pycolmap.Camera(model=model, width=1280, height=960, params=numbers)
    path.write_text(f"1 {model} 1280 960 {' '.join(map(str, numbers))}\n")
    ours = ts.Camera.load(path)
    rays = np.random.default_rng(3).normal(size=(50, 3)) * [1, 1, 0.1] + [0, 0, 1]
    seen = np.array([theirs.img_from_cam(ray) for ray in rays]).reshape(-1, 2)
    np.testing.assert_allclose(ours.project(rays), seen - 0.5, atol=1e-9)
    numbers[-2] = 0.001
    path.write_text(f"1 {model} 1280 960 {' '.join(map(str, numbers))}\n")
    with pytest.raises(ValueError, match=r"THIN_PRISM_FISHEYE.*sx1 0\.001"):
        ts.Camera.load(path)


def test_colmap_files_with_several_cameras(tmp_path):
    (tmp_path / "cameras.txt").write_text(
        "# Camera list\n"
        "1 SIMPLE_RADIAL 3072 2304 2559.81 1536 1152 -0.0204997\n"
        "2 PINHOLE 3072 2304 2560.56 2560.57 1536 1152\n"
        "7 FOV 100 100 50 50 50 50 0.9\n"
    )
    first = Camera.load(tmp_path / "cameras.txt", name="1")
    assert (first.fx, first.fy, first.cx, first.cy) == (2559.81, 2559.81, 1535.5, 1151.5)
    assert (first.model, first.distortion[0]) == ("radial1", -0.0204997)
    assert Camera.load(tmp_path / "cameras.txt", name="2").model == "none"
    with pytest.raises(ValueError, match=r"camera 7: the model 'FOV' cannot be read"):
        Camera.load(tmp_path / "cameras.txt", name="7")


METASHAPE_FILE = """\
<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>{projection}</projection>
  <width>1920</width>
  <height>1080</height>
  <f>1430.15016509976</f>
  <cx>-24.1342060175983</cx>
  <cy>17.5452248329602</cy>
  <b1>1.5</b1>
  <b2>-4.25145544487403</b2>
  <k1>-0.118322055927498</k1>
  <k2>0.293632083518507</k2>
  {further}
  <date>2017-11-14T23:30:12Z</date>
</calibration>
"""
METASHAPE_CAMERA = {
    **{"f": 1430.15016509976, "cx": -24.1342060175983, "cy": 17.5452248329602},
    **{"b1": 1.5, "b2": -4.25145544487403, "k1": -0.118322055927498, "k2": 0.293632083518507},
}


def projected_by_metashape(points, projection, **numbers):
    """Pixels as "Camera models" of its manual has them, (0, 0) the corner of the first one."""
    v = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0) | METASHAPE_CAMERA | numbers
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if projection == "fisheye":
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    r2 = x * x + y * y
    radial = 1 + r2 * (v["k1"] + r2 * (v["k2"] + r2 * (v["k3"] + r2 * v["k4"])))
    dx = x * radial + v["p1"] * (r2 + 2 * x * x) + 2 * v["p2"] * x * y
    dy = y * radial + v["p2"] * (r2 + 2 * y * y) + 2 * v["p1"] * x * y
    u = 1920 * 0.5 + v["cx"] + dx * v["f"] + dx * v["b1"] + dy * v["b2"]
    return np.column_stack([u, 1080 * 0.5 + v["cy"] + dy * v["f"]])


@pytest.mark.parametrize(
    ("projection", "model", "further"),
    [
        ("frame", "radial2", {}),
        ("frame", "brown", {"k3": -0.05, "p1": 0.000330080086304322, "p2": 0.00182154893322038}),
        ("fisheye", "fisheye2", {}),
        ("fisheye", "fisheye", {"k3": -0.02, "k4": 0.001}),
    ],
)
def test_metashape_s_cameras_are_what_its_manual_says(tmp_path, projection, model, further):
    lines = "".join(f"<{key}>{value}</{key}>" for key, value in further.items())
    path = tmp_path / "sensor.xml"
    path.write_text(METASHAPE_FILE.format(projection=projection, further=lines))
    loaded = load_camera(path)
    camera = loaded.camera
    assert (loaded.format, camera.model, camera.image_size) == ("metashape", model, (1920, 1080))
    assert camera.skew == METASHAPE_CAMERA["b2"]
    points = np.array([[0.3, 0.2, 1.0], [-0.5, 0.1, 1.0], [0.6, -0.3, 1.0]])
    theirs = projected_by_metashape(points, projection, **further)
    np.testing.assert_allclose(camera.project(points) + 0.5, theirs, atol=1e-9)
    # It writes what it has read: the principal point may lose a last digit on the way.
    again = Camera.load(saved(camera, tmp_path / "metashape.xml"))
    assert_same(again, camera, tolerance=2.3e-13)
    assert again.model == camera.model


METASHAPE_EXPORT = """\
<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">{sensors}
    </sensors>
    <cameras next_id="1" next_group_id="0">
      <camera id="0" sensor_id="0" component_id="0" label="DJI_0001">
        <transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform>
      </camera>
    </cameras>
  </chunk>
</document>
"""
METASHAPE_SENSOR = """
      <sensor id="{number}" label="{label}" type="frame">
        <resolution width="1920" height="1080"/>
        <property name="focal_length" value="10.26"/>
        <calibration type="frame" class="initial">
          <resolution width="1920" height="1080"/>
          <f>1400</f>
        </calibration>
        <calibration type="frame" class="{kind}">
          <resolution width="1920" height="1080"/>
          <f>{f}</f>
          <cx>-24.125</cx>
          <k1>-0.0625</k1>
          <p1>0.00390625</p1>
        </calibration>
      </sensor>"""


def exported_by_metashape(path, *labels, kind="adjusted"):
    sensors = "".join(
        METASHAPE_SENSOR.format(number=number, label=label, kind=kind, f=1430.5 + number)
        for number, label in enumerate(labels)
    )
    path.write_text(METASHAPE_EXPORT.format(sensors=sensors))
    return path


def test_sensors_of_metashape_s_exported_cameras_are_read(tmp_path):
    path = exported_by_metashape(tmp_path / "cameras.xml", "FC6310")
    loaded = load_camera(path)
    camera = loaded.camera
    assert (loaded.format, camera.image_size) == ("metashape", (1920, 1080))
    assert (camera.fx, camera.cx, camera.cy) == (1430.5, 959.5 - 24.125, 539.5)
    np.testing.assert_array_equal(camera.distortion, [-0.0625, 0, 0, 0.00390625, 0])

    exported_by_metashape(path, "wide", "tele (24mm)")
    with pytest.raises(ValueError, match=r"wide.*tele \(24mm\)"):
        Camera.load(path)
    assert Camera.load(path, name="tele (24mm)").fx == 1431.5
    exported_by_metashape(path, "FC6310", "FC6310")
    assert Camera.load(path, name="sensor 1").fx == 1431.5


def test_exported_cameras_without_a_calibration_are_refused(tmp_path):
    path = exported_by_metashape(tmp_path / "cameras.xml", "FC6310", kind="other")
    with pytest.raises(ValueError, match="'FC6310' has no adjusted calibration: align its"):
        Camera.load(path)
    exported_by_metashape(path)
    with pytest.raises(ValueError, match="no sensor: export the cameras, File > Export"):
        Camera.load(path)


def test_a_frame_of_metashape_s_with_k4_is_read_as_the_nearest(tmp_path):
    path = tmp_path / "sensor.xml"
    text = METASHAPE_FILE.format(projection="frame", further="<k4>0.004</k4><p1>0.001</p1>")
    path.write_text(text)
    with pytest.raises(ValueError, match='"k4" and "b2" are not read together'):
        Camera.load(path)
    path.write_text(text.replace("<b2>-4.25145544487403</b2>", ""))
    with pytest.raises(ts.LensModelError, match="Metashape's frame with k4 is none of") as info:
        Camera.load(path)
    camera = Camera.load(path, approximate=True)
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.8, 0.8, (9000, 2)), np.ones(9000)])
    seen = projected_by_metashape(points, "frame", b2=0.0, k4=0.004, p1=0.001) - 0.5
    inside = np.all((seen >= 0) & (seen <= [1919, 1079]), axis=1)
    off = np.linalg.norm(camera.project(points[inside]) - seen[inside], axis=1)
    assert 0.5 * info.value.worst < off.max() < 1.01 * info.value.worst


def test_nerfstudios_pixels_begin_at_the_corner(tmp_path):
    camera = random_camera(13)
    members = json.loads(saved(camera, tmp_path / "transforms.json").read_text())
    assert (members["cx"], members["cy"]) == (camera.cx + 0.5, camera.cy + 0.5)
    keys = ("k1", "k2", "p1", "p2", "k3")
    assert tuple(members[key] for key in keys) == tuple(camera.distortion)
    assert (members["k4"], members["camera_model"], members["frames"]) == (0, "OPENCV", [])
    assert (members["w"], members["h"], members["fl_x"], members["fl_y"]) == (
        *SIZE,
        camera.fx,
        camera.fy,
    )


def test_nerfstudio_files_of_others(tmp_path):
    path = tmp_path / "transforms.json"
    shared = {"w": 800, "h": 600, "fl_x": 700.0, "cx": 400.5, "cy": 300, "k1": -0.1}
    frames = [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}]
    path.write_text(json.dumps({**shared, "frames": frames}))
    camera = Camera.load(path)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (700, 700, 400, 299.5)
    assert (camera.distortion[0], camera.model) == (-0.1, "radial1")
    # instant-ngp gives the angle of view.
    path.write_text(json.dumps({"w": 800, "h": 600, "camera_angle_x": 2 * np.arctan(0.5)}))
    camera = Camera.load(path)
    assert camera.fx == pytest.approx(800)
    assert (camera.cx, camera.cy) == (399.5, 299.5)
    # And the vertical one, and null for what it does not know.
    angles = {"camera_angle_x": 1.2, "camera_angle_y": 0.6, "k3": None}
    path.write_text(json.dumps({"w": 1280, "h": 960, **angles}))
    camera = Camera.load(path)
    expected = (640 / np.tan(0.6), 480 / np.tan(0.3))
    np.testing.assert_allclose((camera.fx, camera.fy), expected)
    # Of a fisheye instant-ngp says that it is one, without a name of the model.
    fisheye = {**shared, "k1": -0.02, "k2": 0.003, "is_fisheye": True}
    path.write_text(json.dumps(fisheye))
    camera = Camera.load(path)
    assert (camera.model, camera.distortion.tolist()) == ("fisheye2", [-0.02, 0.003, 0, 0])
    path.write_text(json.dumps({**fisheye, "is_fisheye": False}))
    assert Camera.load(path).model == "radial2"
    path.write_text(json.dumps({**fisheye, "is_fisheye": 1}))
    with pytest.raises(ValueError, match='"is_fisheye" must be true or false'):
        Camera.load(path)
    # Intrinsics of each frame, the size of all of them.
    frames = [{"file_path": name, "fl_x": fl_x} for name, fl_x in (("a.png", 500), ("b.png", 600))]
    path.write_text(json.dumps({"w": 800, "h": 600, "frames": frames}))
    with pytest.raises(ValueError, match=r"2 cameras, a\.png, b\.png"):
        Camera.load(path)
    assert Camera.load(path, name="b.png").fx == 600
    # A coefficient of r^8 that is none of trisquare's: the nearest, against a computation by hand.
    path.write_text(json.dumps({**shared, "k4": 0.05}))
    with pytest.raises(ts.LensModelError, match="with k4") as info:
        Camera.load(path)
    radius = np.linspace(0, 0.65, 60)
    ideal = np.column_stack([0.8 * radius, 0.6 * radius, np.ones(60)])
    seen = 700 * ideal[:, :2] * (1 - 0.1 * radius**2 + 0.05 * radius**8)[:, None] + [400, 299.5]
    off = np.linalg.norm(info.value.nearest.project(ideal) - seen, axis=1)
    assert off.max() < info.value.worst < 1


MRCAL_SCRIPT = """\
import sys, json, numpy as np, mrcal
model = mrcal.cameramodel(sys.argv[1])
points = np.array(json.loads(sys.stdin.read()))
name, intrinsics = model.intrinsics()
seen = mrcal.project(points, name, intrinsics)
size = [int(side) for side in model.imagersize()]
mrcal.cameramodel(intrinsics=(name, intrinsics), imagersize=size).write(sys.argv[2])
print(json.dumps([name, size, seen.tolist()]))
"""


def mrcal_is_here():
    if not DEBIAN_PYTHON.exists():
        return False
    asked = subprocess.run([DEBIAN_PYTHON, "-c", "import mrcal"], capture_output=True, check=False)
    return asked.returncode == 0


def test_mrcal_itself_sees_the_same(tmp_path):
    if not mrcal_is_here():
        pytest.skip("Debian's mrcal is not installed")
    wanted = {"none": "PINHOLE", "radial1": "OPENCV4", "radial3": "OPENCV5", "brown": "OPENCV5"}
    for model, kind in wanted.items():
        camera = random_camera(14, model)
        path, theirs = saved(camera, tmp_path / "left.cameramodel"), tmp_path / "mrcal.cameramodel"
        rays = camera.unproject(pixel_grid(camera))
        answer = subprocess.run(
            [DEBIAN_PYTHON, "-c", MRCAL_SCRIPT, path, theirs],
            input=json.dumps(rays.tolist()),
            capture_output=True,
            text=True,
            check=True,
        )
        name, size, seen = json.loads(answer.stdout)
        assert (name, tuple(size)) == (f"LENSMODEL_{kind}", SIZE)
        assert np.abs(np.array(seen) - pixel_grid(camera)).max() < 1e-9
        # It writes ten digits or more.
        read = Camera.load(theirs)
        np.testing.assert_allclose(read.K, camera.K, rtol=1e-9)
        np.testing.assert_allclose(read.distortion, camera.distortion, rtol=1e-9)


def test_mrcal_files_are_pythons_dictionaries(tmp_path):
    (tmp_path / "a.cameramodel").write_text(
        "# generated on 2026-11-21 with 'mrcal-calibrate-cameras # --focal 1900'\n"
        "{\n    'lensmodel':  \"LENSMODEL_OPENCV8\",\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0, }]\n"
        "    'intrinsics': [ 1000, 1001., 639.5, 479.5, -0.1, 1e-2, 0, 0, 0, 0, 0, 0,],\n"
        "    'extrinsics': [ 0.1, 0, 0, 1, 0, 0,],\n    'icam_intrinsics': 0,\n"
        "    'optimization_inputs': b'P5&1%r{l#)}',\n    'imagersize': (1280, 960, # both\n)\n}\n"
    )
    camera = Camera.load(tmp_path / "a.cameramodel")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (1000, 1001, 639.5, 479.5)
    assert (camera.model, camera.image_size) == ("radial2", (1280, 960))


def seen_by_hugin(path, pixels):
    """The ideal normalised points at pixels: of the flat panorama that Hugin itself makes."""
    width, height, view = re.search(r"^p f0 w(\d+) h(\d+) v(\d+)", path.read_text(), re.M).groups()
    answer = subprocess.run(
        ["pano_trafo", path, "0"],
        input="".join(f"{x!r} {y!r}\n" for x, y in pixels.tolist()),
        capture_output=True,
        text=True,
        check=True,
    )
    flat = np.array([[float(word) for word in line.split()] for line in answer.stdout.splitlines()])
    centre = np.array([float(width) - 1, float(height) - 1]) / 2
    return (flat - centre) / (0.5 * float(width) / np.tan(np.radians(float(view)) / 2))


@pytest.mark.skipif(shutil.which("pano_trafo") is None, reason="Debian's hugin-tools are not here")
@pytest.mark.parametrize("size", [SIZE, SIZE[::-1]])
def test_hugin_itself_sees_the_same(tmp_path, size):
    path = tmp_path / "lens.pto"
    for seed, model in ((17, "none"), (18, "radial1"), (19, "radial1")):
        camera = camera_for_hugin(seed, model)
        camera = Camera(camera.K, camera.distortion, size, model)
        camera.save(path)
        pixels = pixel_grid(camera)
        ideal = np.c_[seen_by_hugin(path, pixels), np.ones(len(pixels))]
        # Its inverse is iterated, and ends at some thousandth of a pixel.
        assert np.abs(camera.project(ideal) - pixels).max() < 5e-3
    camera = Camera(camera.K, [-0.1, 0.03, 0, 0, 0], size)
    approximation = camera.save(path, approximate=True)
    ideal = np.c_[seen_by_hugin(path, pixels), np.ones(len(pixels))]
    off = np.linalg.norm(camera.project(ideal) - pixels, axis=1)
    assert off.max() < 1.1 * approximation.worst + 5e-3
    assert off.max() > 0.5 * approximation.worst


@pytest.mark.filterwarnings("error")
def test_a_coefficient_that_all_but_vanishes_is_written_to_hugin(tmp_path):
    path = tmp_path / "lens.pto"
    camera = Camera(camera_for_hugin(18, "radial1").K, [1e-320, 0, 0, 0, 0], (640, 480), "radial1")
    camera.save(path)
    np.testing.assert_allclose(Camera.load(path).K, camera.K)


def test_hugins_polynomial_is_the_one_of_its_documentation(tmp_path):
    path = tmp_path / "lens.pto"
    a, b, c, view = 0.011, -0.031, 0.007, 50.0
    path.write_text(
        f'p f2 w3000 h1500 v360 n"TIFF"\ni w1000 h800 f0 v{view} Ra0 Rb0 a{a} b{b} c{c} d5 e-3 '
        'g0 t0 Eev12.5 r0 p0 y0 TrX0 Vm5 n"a b=c.jpg"\n'
        'i w1000 h800 f0 v=0 a=0 b=0 c=0 d=0 e=0 g=0 t=0 r1 p2 y3 n"b.jpg"\n'
    )
    with pytest.raises(ts.LensModelError, match="Hugin's a, b, c is none of trisquare's") as info:
        Camera.load(path)
    pinhole = 500 / np.tan(np.radians(view / 2))
    ideal = np.random.default_rng(2).uniform(-0.35, 0.35, (3000, 2))
    radius = np.linalg.norm(ideal, axis=1) * pinhole / 400
    stretch = a * radius**3 + b * radius**2 + c * radius + 1 - a - b - c
    seen = ideal * pinhole * stretch[:, None] + [499.5 + 5, 399.5 - 3]
    inside = np.all((seen >= 0) & (seen <= [999, 799]), axis=1)
    off = np.linalg.norm(
        info.value.nearest.project(np.c_[ideal, np.ones(3000)])[inside] - seen[inside], axis=1
    )
    assert 0.6 * info.value.worst < off.max() < 1.02 * info.value.worst < 1
    # Without a and c it is k1, exactly.
    path.write_text(path.read_text().replace(f"a{a}", "a0").replace(f"c{c}", "c0"))
    camera = Camera.load(path)
    assert camera.model == "radial1"
    stretch = b * radius**2 + 1 - b
    seen = ideal * pinhole * stretch[:, None] + [499.5 + 5, 399.5 - 3]
    np.testing.assert_allclose(camera.project(np.c_[ideal, np.ones(3000)]), seen, atol=1e-10)
    # Lenses that differ must be chosen from.
    path.write_text(path.read_text().replace("v=0", "v40"))
    with pytest.raises(ValueError, match="2 cameras, 0, 1"):
        Camera.load(path)
    assert Camera.load(path, name="1").fx > camera.fx


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize("is_flat", [False, True])
def test_opencvs_matrices_may_be_lists(tmp_path, suffix, is_flat):
    """As scripts dump arrays, without FileStorage."""
    K, distortion = [[900.0, 0, 640], [0, 901, 480], [0, 0, 1]], [-0.28, 0.1, 0.001, 0.002, 0.01]
    matrices = (np.ravel(K).tolist(), distortion) if is_flat else (K, [distortion])
    members = dict(zip(("mtx", "dist"), matrices, strict=True))
    members |= {"width": 1280, "height": 960}
    path = tmp_path / f"camera{suffix}"
    dump = json.dumps if suffix == ".json" else yaml.safe_dump
    path.write_text(dump(members))
    camera = Camera.load(path)
    np.testing.assert_array_equal(camera.K, K)
    np.testing.assert_array_equal(camera.distortion, distortion)
    path.write_text(dump({**members, "mtx": [[900.0, "x"]]}))
    with pytest.raises(ValueError, match="mtx"):
        Camera.load(path)


def test_lensfuns_lenses_of_one_name_are_told_apart(tmp_path):
    """A database lists a lens once for each size of sensor it is used with."""
    lens = (
        "<lens><maker>Canon</maker><model>EF 50mm</model><cropfactor>{}</cropfactor><calibration>"
        '<distortion model="poly3" focal="50" k1="-0.01"/></calibration></lens>'
    )
    crops = ("1.0", "1.6", "1.6")
    path = tmp_path / "lenses.xml"
    path.write_text(f"<lensdatabase>{''.join(map(lens.format, crops))}</lensdatabase>")
    with pytest.raises(ValueError, match="there are 3 cameras"):
        Camera.load(path, image_size=SIZE)
    names = ("EF 50mm 50", "EF 50mm 50, Canon at crop 1.6", "EF 50mm 50, Canon at crop 1.6'")
    focal = [Camera.load(path, name=name, image_size=SIZE, approximate=True).fx for name in names]
    np.testing.assert_allclose(focal, np.array([1.0, 1.6, 1.6]) * focal[0], rtol=1e-3)


@pytest.mark.parametrize("size", [SIZE, SIZE[::-1]])
@pytest.mark.parametrize(
    "distortion", [[-0.11, 0, 0, 0, 0], [-0.14, 0.03, 0, 0, 0], [0.1, 0.02, 0, 0, 0.02]]
)
def test_lensfun_itself_sees_the_same(tmp_path, size, distortion):
    lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy is not installed")
    camera = camera_for_hugin(20, "none")
    camera = Camera(camera.K, distortion, size, "radial3")
    approximation = camera.save(tmp_path / "lensfun.xml", approximate=True)
    assert (approximation is None) == (distortion[4] == 0)
    database = lensfunpy.Database(
        xml=(tmp_path / "lensfun.xml").read_text(), load_common=False, load_bundled=False
    )
    (lens,) = database.lenses
    width, height = size
    modifier = lensfunpy.Modifier(lens, lens.crop_factor, width, height)
    distortion_only = lensfunpy.ModifyFlags.DISTORTION
    modifier.initialize(lens.min_focal, 8.0, 1000.0, scale=1.0, flags=distortion_only)
    seen = modifier.apply_geometry_distortion().reshape(-1, 2)
    flat = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    # Its undistorted picture is a pinhole's of the focal length that the file says.
    pinhole = lens.min_focal / np.hypot(36, 24) * np.hypot(width - 1, height - 1)
    ideal = (flat - camera.K[:2, 2]) / pinhole
    inside = np.all((seen >= 0) & (seen <= [width - 1, height - 1]), axis=1)
    assert inside.mean() > 0.5
    off = np.abs(camera.project(np.c_[ideal, np.ones(len(ideal))][inside]) - seen[inside])
    # It adds up floats of 24 bits along a row.
    single = 0.02
    if approximation is None:
        assert off.max() < single
    else:
        # With SSE, lensfun 0.3.4 computes its ptlens with a noise of up to 0.3 px.
        assert np.sqrt(np.mean(off**2)) < approximation.rms + 0.1


def test_names_tell_the_format_that_is_written(tmp_path):
    camera = random_camera(15, "radial2")
    for name, known in FILES.items():
        if name != "opencv.json":
            camera.save(tmp_path / name, approximate=known in PANORAMA)
            assert load_camera(tmp_path / name, approximate=True, image_size=SIZE).format == known
    for name in ("camera", "camera.doc"):
        with pytest.raises(
            ValueError, match=rf"'{name}' tells no camera format.*{FORMAT_NAMES[-1]}"
        ):
            camera.save(tmp_path / name)
    with pytest.raises(ValueError, match="unknown format"):
        camera.save(tmp_path / "camera.json", format="dcraw")
    with pytest.raises(TypeError, match="format must be a string"):
        camera.save(tmp_path / "camera.json", format=3)


@pytest.mark.parametrize("approximate", [False, True])
def test_a_lens_that_no_model_of_a_format_comes_near_is_named_as_such(tmp_path, approximate):
    matrix = [[500.0, 0, 640], [0, 500, 480], [0, 0, 1]]
    camera = ts.Camera(matrix, [0.01, 0.001, 0, 0], (1280, 960), "fisheye")
    for name in ("a.cameramodel", "a.pto"):
        with pytest.raises(ts.LensModelError, match=r"cannot hold this camera.*comes near") as info:
            camera.save(tmp_path / name, approximate=approximate)
        assert (info.value.nearest, info.value.rms) == (None, np.inf)
        assert pickle.loads(pickle.dumps(info.value)).worst == np.inf
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("as_text", [True, False])
@pytest.mark.parametrize("name", [None, "opencv", "kalibr"])
def test_open_files_are_written_and_read_as_named_ones(tmp_path, name, as_text):
    camera = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), (1280, 960))
    buffer = io.StringIO() if as_text else io.BytesIO()
    camera.save(buffer, format=name)
    camera.save(tmp_path / "camera", format=name or "trisquare")
    content = buffer.getvalue()
    named = (tmp_path / "camera").read_text()
    assert content == (named if as_text else named.encode())
    buffer.seek(0)
    assert ts.Camera.load(buffer) == ts.Camera.load(tmp_path / "camera")


@pytest.mark.parametrize("mode", ["w+", "w+b"])
def test_files_that_wrap_others_are_written_as_what_they_are(mode):
    camera = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), (1280, 960))
    with tempfile.NamedTemporaryFile(mode) as file:
        camera.save(file)
        file.seek(0)
        assert ts.Camera.load(file) == camera


@pytest.mark.parametrize("path", [None, 5, b"camera.json", {}])
def test_what_is_neither_a_name_nor_open_is_refused(path):
    camera = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), (1280, 960))
    message = f"^path must be a name or an open file, not {type(path).__name__}$"
    for act in (camera.save, ts.Camera.load, ts.Calibration.load):
        with pytest.raises(TypeError, match=message):
            act(path)


def test_open_files_that_are_no_text_or_closed_are_named(tmp_path):
    (tmp_path / "photo.png").write_bytes(b"\x89PNG\r\n")
    for load in (ts.Camera.load, ts.Calibration.load):
        with (
            (tmp_path / "photo.png").open(encoding="utf-8") as file,
            pytest.raises(ValueError, match=r"^the open file: not a text file"),
        ):
            load(file)
        with pytest.raises(ValueError, match=r"^the open file: .*closed file"):
            load(file)


def test_a_result_goes_through_an_open_file():
    result = ts.calibrate_edges(edges_of(squares(5), noise=0.05, seed=1), (1280, 960))
    buffer = io.BytesIO()
    result.save(buffer)
    assert buffer.getvalue().decode() == result.to_json()
    buffer.seek(0)
    assert ts.Calibration.load(buffer) == result
    with pytest.raises(ValueError, match="the open file: a calibration is JSON"):
        ts.Calibration.load(io.StringIO("camera"))
    with pytest.raises(ValueError, match="the open file: "):
        ts.Camera.load(io.BytesIO(b"camera"))
