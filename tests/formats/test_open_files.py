"""Cameras in files that are already open."""

import io
import tempfile

import numpy as np
import pytest
from scenes import edges_of, squares

import trisquare as ts


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
