"""Camera files of nerfstudio."""

import json

import numpy as np
import pytest
from random_cameras import SIZE, random_camera, saved

import trisquare as ts
from trisquare import Camera


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
    # instant-ngp states the angle of view.
    path.write_text(json.dumps({"w": 800, "h": 600, "camera_angle_x": 2 * np.arctan(0.5)}))
    camera = Camera.load(path)
    assert camera.fx == pytest.approx(800)
    assert (camera.cx, camera.cy) == (399.5, 299.5)
    # It may also state the vertical one, and null for what it does not know.
    angles = {"camera_angle_x": 1.2, "camera_angle_y": 0.6, "k3": None}
    path.write_text(json.dumps({"w": 1280, "h": 960, **angles}))
    camera = Camera.load(path)
    expected = (640 / np.tan(0.6), 480 / np.tan(0.3))
    np.testing.assert_allclose((camera.fx, camera.fy), expected)
    # instant-ngp marks a fisheye without naming a model.
    fisheye = {**shared, "k1": -0.02, "k2": 0.003, "is_fisheye": True}
    path.write_text(json.dumps(fisheye))
    camera = Camera.load(path)
    assert (camera.model, camera.distortion.tolist()) == ("fisheye2", [-0.02, 0.003, 0, 0])
    path.write_text(json.dumps({**fisheye, "is_fisheye": False}))
    assert Camera.load(path).model == "radial2"
    path.write_text(json.dumps({**fisheye, "is_fisheye": 1}))
    with pytest.raises(ValueError, match='"is_fisheye" must be true or false'):
        Camera.load(path)
    # Intrinsics for each frame, and one size for all frames.
    frames = [{"file_path": name, "fl_x": fl_x} for name, fl_x in (("a.png", 500), ("b.png", 600))]
    path.write_text(json.dumps({"w": 800, "h": 600, "frames": frames}))
    with pytest.raises(ValueError, match=r"2 cameras, a\.png, b\.png"):
        Camera.load(path)
    assert Camera.load(path, name="b.png").fx == 600
    # No model of trisquare has a coefficient of r^8: compare the nearest with a computation by
    # hand.
    path.write_text(json.dumps({**shared, "k4": 0.05}))
    with pytest.raises(ts.LensModelError, match="with k4") as info:
        Camera.load(path)
    radius = np.linspace(0, 0.65, 60)
    ideal = np.column_stack([0.8 * radius, 0.6 * radius, np.ones(60)])
    seen = 700 * ideal[:, :2] * (1 - 0.1 * radius**2 + 0.05 * radius**8)[:, None] + [400, 299.5]
    off = np.linalg.norm(info.value.nearest.project(ideal) - seen, axis=1)
    assert off.max() < info.value.worst < 1
