"""Each example runs in an interpreter that has loaded only what the example imports."""

import json
import os
import subprocess
import sys
from importlib import resources

import pytest
from test_examples import CALLED

import trisquare as ts

SCRIPT = """
import doctest, json, os, sys
import numpy as np
import trisquare as ts

failed = []
for name, source in json.load(open("examples.json")).items():
    if os.fork():
        _, status = os.wait()
        failed += [name] * (status != 0)
        continue
    given = {"ts": ts, "np": np}
    if os.path.exists("given.json") and ("result" in source or "camera" in source):
        given["result"] = ts.Calibration.from_json(open("given.json").read())
        given["camera"] = given["result"].camera
    example = doctest.DocTestParser().get_doctest(source, given, name, None, 0)
    failures = doctest.DocTestRunner().run(example).failed
    sys.stdout.flush()
    os._exit(failures > 0)
sys.exit(" ".join(failed) or 0)
"""


def run(examples, folder):
    (folder / "examples.json").write_text(json.dumps(examples))
    return subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that forks")
def test_every_example_loads_what_it_needs(tmp_path):
    photo = tmp_path / "photo.jpg"
    photo.write_bytes((resources.files("trisquare") / "data" / "demo.png").read_bytes())
    (tmp_path / "given.json").write_text(ts.calibrate(photo).to_json(edges=True))
    done = run({name: public.__doc__ for name, public in CALLED.items()}, tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that forks")
def test_a_wrong_example_is_told(tmp_path):
    done = run({"right": ">>> 1 + 2\n3\n", "wrong": ">>> 1 + 1\n3\n"}, tmp_path)
    assert (done.returncode, done.stderr) == (1, "wrong\n")


def test_cameras_are_saved_and_loaded_before_anything_else_is(tmp_path):
    example = (
        ">>> ts.Camera([[900, 0, 319.5], [0, 900, 239.5], [0, 0, 1]], [0, 0, 0, 0, 0], (640, 480))"
        ".save('camera.yaml')\n>>> ts.Camera.load('camera.yaml').fx\n900.0\n"
    )
    done = run({"save": example}, tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
