"""Common properties of the files of every format."""

import cv2
import numpy as np
import pytest
from camera_files import FILES, PANORAMA
from random_cameras import MODELS, SIZE, assert_same, camera_for_hugin, random_camera, saved

import trisquare as ts
from trisquare import Camera
from trisquare.formats import FORMAT_NAMES, load_camera


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
        # Moving the origin of a principal point by half a pixel may change its last digit by
        # rounding.
        shifted = FILES[name] in ("colmap", "nerfstudio")
        if FILES[name] in PANORAMA:  # which store other numbers, from which ours are computed
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
    with pytest.raises(ts.LensModelError, match="cannot store this camera"):
        camera.save(tmp_path / "camchain.yaml")
    # OpenCV has no skew: the nearest of its lens models that can be fitted is named.
    skewed = Camera([[900.5, 1.5, 641.25], [0, 901, 480], [0, 0, 1]], distortion, SIZE, model)
    with pytest.raises(
        ts.LensModelError, match=r"skew 1\.5 px\); the nearest camera that it can store is brown"
    ):
        skewed.save(tmp_path / "camera.yaml")


def test_names_tell_the_format_that_is_written(tmp_path):
    camera = random_camera(15, "radial2")
    for name, known in FILES.items():
        if name != "opencv.json":
            camera.save(tmp_path / name, approximate=known in PANORAMA)
            assert load_camera(tmp_path / name, approximate=True, image_size=SIZE).format == known
    for name in ("camera", "camera.doc"):
        with pytest.raises(
            ValueError, match=rf"'{name}' determines no camera format.*{FORMAT_NAMES[-1]}"
        ):
            camera.save(tmp_path / name)
    with pytest.raises(ValueError, match="unknown format"):
        camera.save(tmp_path / "camera.json", format="dcraw")
    with pytest.raises(TypeError, match="format must be a string"):
        camera.save(tmp_path / "camera.json", format=3)
