"""Camera files of ROS and Kalibr."""

import cv2
import numpy as np
import pytest
import yaml
from random_cameras import SIZE, random_camera, saved

import trisquare as ts
from trisquare import Camera
from trisquare.formats import load_camera


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
        # Small numbers as written by C++ libraries.
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
    with pytest.raises(ValueError, match=r"2 cameras, cam0, cam1: choose one with name="):
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
    # The substitute for a fisheye, compared with OpenCV's fisheye.
    with pytest.raises(ts.LensModelError, match="cannot store this camera") as info:
        right.save(tmp_path / "right.cameramodel")
    pixels = np.stack(np.meshgrid(np.linspace(0, 751, 15), np.linspace(0, 479, 11)), axis=-1)
    pixels = pixels.reshape(-1, 1, 2)
    ideal = cv2.fisheye.undistortPoints(pixels, right.K, right.distortion)
    seen = info.value.nearest.project(np.c_[ideal[:, 0], np.ones(len(ideal))])
    off = np.linalg.norm(seen - pixels[:, 0], axis=1)
    assert 0.7 * info.value.worst < off.max() < 1.02 * info.value.worst


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
