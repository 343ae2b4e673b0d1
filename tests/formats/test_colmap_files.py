"""Camera files of COLMAP, read by COLMAP itself."""

import numpy as np
import pytest
from random_cameras import MODELS, SIZE, assert_same, pixel_grid, random_camera, saved

import trisquare as ts
from trisquare import Camera


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
