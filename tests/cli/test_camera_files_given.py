"""Camera files of other programs as inputs of commands, and the advice in their errors."""

import shlex
import shutil
from importlib import resources

import cv2
import numpy as np
import pytest

import trisquare as ts

TWO_CAMERAS = "1 PINHOLE 640 480 500 501 320 240\n2 RADIAL 640 480 510 320 240 -0.1 0.01\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two cameras.txt").write_text(TWO_CAMERAS)
    cv2.imwrite("photo.png", np.full((480, 640), 128, np.uint8))
    return tmp_path


def commands_with(file):
    """Return a decorator that runs a test with each command that reads a camera file."""
    commands = [
        ("undistort", "photo.png", "-o", "out.png", "--camera", file),
        ("compare", file, file),
        ("calibrate", "photo.png", "--initial", file),
        ("convert", file, "other.json"),
    ]
    return pytest.mark.parametrize("words", commands, ids=lambda words: words[0])


@commands_with("two cameras.txt")
def test_one_camera_of_several_is_taken_out_as_the_error_says(run, folder, words):
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert "two cameras.txt: there are 2 cameras, 1, 2: " in err
    program, *told = shlex.split(err.partition("take one out: ")[2])
    assert program == "trisquare"
    assert run(*told)[0] == 0
    assert ts.Camera.load("one.json").fy == 501
    if words[0] == "undistort":
        shutil.copy("one.json", "two cameras.txt")
        assert run(*words)[0] == 0


@commands_with("sizeless.yaml")
def test_a_file_without_the_picture_s_size_is_given_one_as_the_error_says(run, folder, words):
    camera = ts.Camera([[450, 0, 319.5], [0, 450, 239.5], [0, 0, 1]], np.zeros(5), (640, 480))
    camera.save("sizeless.yaml")
    lines = (folder / "sizeless.yaml").read_text().splitlines(keepends=True)
    (folder / "sizeless.yaml").write_text("".join(x for x in lines if "image_" not in x))
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert "sizeless.yaml: " in err
    told = " ".join(err.split()).partition("(trisquare ")[2].partition(")")[0]
    placeholders = {"FILE": "sizeless.yaml", "WxH": "640x480"}
    assert run(*(placeholders.get(word, word) for word in told.split()))[0] == 0
    assert np.array_equal(ts.Camera.load("camera.json").K, camera.K)


def test_a_camera_of_another_resolution_is_scaled_as_the_error_says(run, folder):
    shutil.copy(resources.files("trisquare") / "data" / "demo.png", "demo.png")
    camera = ts.Camera([[450, 0, 319.5], [0, 450, 239.5], [0, 0, 1]], np.zeros(5), (640, 480))
    camera.save("small.json")
    words = ("calibrate", "demo.png", "--fix", "focal", "--initial")
    code, _, err = run(*words, "small.json")
    assert code == 2
    told = err.partition("trisquare convert ")[2].partition(")")[0]
    assert told == "--rescale 1280x960"
    assert run("convert", "small.json", "large.json", *told.split())[0] == 0
    assert ts.Camera.load("large.json").K.tolist() == camera.rescaled((1280, 960)).K.tolist()
    assert run(*words, "large.json")[0] == 0
    code, _, err = run("convert", "large.json", "narrow.json", "--rescale", "640x600")
    assert code == 2
    assert "large.json: " in err
