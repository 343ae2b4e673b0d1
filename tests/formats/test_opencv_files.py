"""Camera files of OpenCV, read and written by OpenCV itself."""

import json

import cv2
import numpy as np
import pytest
import yaml
from camera_files import opencv_storage
from random_cameras import SIZE, assert_same, random_camera, saved

from trisquare import Camera
from trisquare.formats import load_camera


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


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize("is_flat", [False, True])
def test_opencvs_matrices_may_be_lists(tmp_path, suffix, is_flat):
    """As written by scripts that dump arrays, without FileStorage."""
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
