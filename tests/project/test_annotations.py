"""Programs that use trisquare, as accepted or refused by a type checker."""

import subprocess
import sys

import pytest

ACCEPTED = """
import numpy as np
import trisquare as ts

camera = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], [0, 0, 0, 0, 0], [1280, 960])
result = ts.calibrate("a.jpg", model=camera.model, fix="aspect,focal", tone=2.2, side="84mm")
ts.calibrate(["a.jpg", b"content", np.zeros((3, 3), np.uint8)], initial=result, model="auto")
edges = ts.PlaneEdges([[0, 1, 0.5], [-1, 0, 0.5]], [[[0, 0], [1, 1]], np.eye(2)], std=0.1)
ts.calibrate_edges([edges], [1280, 960], model="brown", method="linear")
ts.predict(camera, [ts.PlannedSquare(np.eye(3), [0, 0, 3])], model="radial2")
ts.measure(result.planes[0], [[1, 2], [3, 4]], result, side=84)
ts.undistort("a.jpg", camera, interpolation="cubic")
"""

REFUSED = """
import trisquare as ts

result = ts.calibrate("a.jpg", model="brwn")
ts.calibrate("a.jpg", method="mll")
ts.Camera(result.camera.K, [0.0] * 5, (1280, 960), "radial")
ts.undistort("a.jpg", result, interpolation="cubc")
"""


def complaints(code, folder):
    """The numbers of the lines with errors by a type checker."""
    (folder / "used.py").write_text(code)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "used.py"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return [int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line]


@pytest.mark.slow
def test_what_is_taken_is_accepted_and_slips_are_not(tmp_path):
    pytest.importorskip("mypy")
    assert complaints(ACCEPTED, tmp_path) == []
    assert complaints(REFUSED, tmp_path) == [4, 5, 6, 7]
