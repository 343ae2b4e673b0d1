"""Camera files of mrcal, read by mrcal itself."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from random_cameras import SIZE, pixel_grid, random_camera, saved

from trisquare import Camera

DEBIAN_PYTHON = Path("/usr/bin/python3")

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
