"""Careless use of the command line: the exit code and message for each line."""

import io
import json
import os
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.cli import pictures_drawn
from trisquare.images.drawn_mark import encode_drawn
from trisquare.images.sources import sources_of

SIZE = (640, 480)
SCENE = squares(11, image_size=SIZE)
PHOTO = simulate.render(SCENE, np.random.default_rng(12))
CALIBRATION = ts.calibrate_edges(edges_of(SCENE), SIZE)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", PHOTO)
    cv2.imwrite("deep.png", PHOTO.astype(np.uint16) * 257)
    cv2.imwrite("black.png", np.zeros_like(PHOTO))
    CALIBRATION.save("camera.json")
    return tmp_path


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("calibrate", ""), 2, "an argument is empty: is a variable of the shell not set?"),
        (("demo", "-o", ""), 2, "an argument is empty"),
        (("calibrate", "photo.png", "--report", "a.pdf"), 2, "let its name end in .html"),
        (("measure", "photo.png", "--camera", "camera.json", "--resolution", "5"), 2, "--rectify"),
        (
            ("measure", "deep.png", "--camera", "camera.json", "--rectify", "above.jpg"),
            2,
            "above.jpg: this format does not store uint16 pixels",
        ),
        (("target", "--check", "several"), 2, "--check takes one photograph of the sheet, not 2"),
        (("batch", os.devnull, "-o", "out"), 2, "cannot read a pipe or device"),
        (("calibrate", "photo.png", "--targets", "chessboard"), 2, "name its inner corners"),
        (("calibrate", "photo.png", "--targets", "charuco"), 2, "name its layout, charuco:10x10"),
        (("predict", "--size", "64x48", "--focal", "50mm"), 2, "the focal length in mm, times"),
        (("calibrate", "photo.png", "--fail-on", "all"), 2, "unknown --fail-on 'all'"),
        (
            ("calibrate", "-", "-"),
            2,
            "- is standard input, which contains one picture: give it once",
        ),
        (
            ("measure", "-", "--camera", "camera.json"),
            2,
            "-: trisquare measure does not read stand",
        ),
        (("undistort", "-", "--camera", "camera.json", "-o", "a.png"), 2, "does not read standard"),
        (("convert", "-", "x.yaml"), 2, "-: trisquare convert does not read standard input"),
        (("straighten", "-", "-o", "l.png"), 2, "does not read standard input: name a file"),
        (("batch", "-", "-o", "r"), 2, "-: trisquare batch does not read standard input"),
        (("predict", "-"), 2, "-: trisquare predict does not read standard input"),
        (("calibrate", "-dash.jpg"), 2, "-d; put -- before arguments that begin with a minus"),
        (
            ("undistort", "photo.png", "--camera", "camera.json", "-o", "-"),
            2,
            "-: pictures cannot be written to standard output: name a file",
        ),
        (("straighten", "photo.png", "-o", "-"), 2, "to standard output: name a file"),
        (("calibrate", "photo.png", "--tone", "99"), 2, "a gamma must be from 0.2 to 5, not 99"),
    ],
)
def test_what_cannot_be_meant_is_refused(run, folder, words, code, said):
    Path("several").mkdir()
    for name in ("a.png", "b.png"):
        cv2.imwrite(f"several/{name}", PHOTO)
    before = sorted(Path().rglob("*"))
    found, out, err = run(*words)
    assert (found, out) == (code, "")
    assert said in err
    assert sorted(Path().rglob("*")) == before


def test_a_link_to_nowhere_is_named_as_one(run, folder):
    Path("link.png").symlink_to("gone.png")
    code, _, err = run("calibrate", "link.png")
    assert code == 5
    assert "link.png: a link to gone.png, which does not exist" in err


def test_a_warning_may_be_a_failure_and_all_is_written_all_the_same(run, folder):
    wide = cv2.resize(PHOTO, None, fx=1.05, fy=1.0, interpolation=cv2.INTER_AREA)
    cv2.imwrite("wide.png", wide)
    assert ts.calibrate("wide.png").warnings[0].severity == "high"
    for severity in ("high", "medium", "low"):
        code, out, _ = run("calibrate", "wide.png", "-o", "kept.json", "--fail-on", severity)
        assert code == 6
        assert "wrote kept.json" in out
    assert ts.calibrate("photo.png").warnings == ()
    assert run("calibrate", "photo.png", "--fail-on", "low")[0] == 0


def test_one_board_is_told_to_be_photographed_again(run, folder):
    rng = np.random.default_rng(3)
    scene = simulate.chessboard_scene(rng, simulate.random_camera(rng))
    cv2.imwrite("board.png", simulate.render(scene, rng))
    code, _, err = run("calibrate", "board.png")
    assert code == 3
    assert "take more pictures of the board" in err


def test_what_may_not_be_looked_at_is_not_called_missing(folder, monkeypatch):
    def denied(name):
        raise PermissionError(13, "Permission denied", name)

    monkeypatch.setattr(os, "stat", denied)
    with pytest.raises(ts.ImageError, match=r"inside/photo\.png: Permission denied") as error:
        sources_of("inside/photo.png")
    assert not isinstance(error.value, ts.MissingImageError)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may read all files")
@pytest.mark.parametrize("name", ["locked.png", "inside/photo.png"])
def test_a_photograph_that_may_not_be_read_is_an_error_of_the_input(run, folder, name):
    Path("inside").mkdir()
    cv2.imwrite("locked.png", PHOTO)
    cv2.imwrite("inside/photo.png", PHOTO)
    Path("locked.png").chmod(0)
    Path("inside").chmod(0)
    code, _, err = run("calibrate", name)
    Path("inside").chmod(0o700)
    assert (code, err) == (5, f"trisquare: error: {name}: Permission denied\n")


def test_hidden_files_of_a_folder_are_no_photographs(run, folder):
    Path("card").mkdir()
    cv2.imwrite("card/photo.png", PHOTO)
    Path("card/._photo.png").write_bytes(b"\0\5\26\7")
    assert run("calibrate", "card", "--quiet")[0] == 0


def test_a_batch_leaves_overlays_out(run, folder):
    Path("mixed").mkdir()
    cv2.imwrite("mixed/photo.png", PHOTO)
    Path("mixed/overlay.png").write_bytes(encode_drawn(PHOTO, "overlay.png"))
    for number, named in enumerate(("mixed", "mixed/*.png")):
        code, out, _ = run("batch", named, "-o", f"out{number}", "--json")
        assert code == 0
        assert json.loads(out)["cameras"] == 1


def test_a_debug_picture_that_fails_does_not_hide_why_the_calibration_did(run, folder, monkeypatch):
    def full(_):
        raise OSError("debug.png: cannot be written: No space left on device")

    monkeypatch.setattr(pictures_drawn, "write_atomically", full)
    code, _, err = run("calibrate", "black.png", "--debug-image", "debug.png")
    assert code == 3
    assert "; the debug picture: debug.png: cannot be written: No space left" in err


@pytest.mark.parametrize("columns", ["20", "0"])
def test_no_terminal_is_too_narrow_for_numbers(run, folder, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    _, out, _ = run("calibrate", "photo.png")
    assert "…" not in out
    assert f"{ts.calibrate('photo.png').camera.fx:.1f}"[:5] in out


def test_a_picture_without_targets_has_no_faults(folder):
    result = ts.calibrate(["photo.png", "black.png"])
    codes = [warning.code for warning in result.warnings]
    assert "nothing_found" in codes
    assert "thresholded" not in codes


def test_a_report_is_made_of_a_photograph_from_a_pipe(run, folder):
    read, write = os.pipe()
    with os.fdopen(write, "wb") as pipe:
        content = Path("photo.png").read_bytes()
        writing = threading.Thread(target=lambda: (pipe.write(content), pipe.close()))
        writing.start()
        code, _, err = run("calibrate", f"/dev/fd/{read}", "--report", "r.html", "--quiet")
        writing.join()
    os.close(read)
    assert (code, err) == (0, "")
    assert Path("r.html").stat().st_size > 10_000


def test_a_polygon_that_crosses_itself_has_no_area(run, folder):
    quad = CALIBRATION.planes[0].corners
    crossed = [f"{x:.1f},{y:.1f}" for x, y in quad[[0, 2, 1, 3]]]
    code, out, _ = run("measure", "photo.png", "--camera", "camera.json", *crossed)
    assert code == 0
    assert "area: none, for the polygon's sides cross" in out


@pytest.mark.parametrize(
    ("content", "code", "said"),
    [
        (None, 0, ""),
        (b"no picture", 5, "the encoded picture: not a readable picture"),
        (bytes(2000), 5, "the encoded picture: has 1001 bytes, more than the 1000"),
    ],
)
def test_a_minus_is_standard_input(run, folder, monkeypatch, content, code, said):
    content = Path("photo.png").read_bytes() if content is None else content
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content)))
    bound = () if code == 0 else ("--max-bytes", 1000)
    found, out, err = run("calibrate", "-", "--json", *bound)
    assert found == code
    assert said in err
    if code == 0:
        assert ts.Calibration.from_json(out).camera == ts.calibrate("photo.png").camera


def test_standard_input_is_one_of_several(run, folder, monkeypatch):
    cv2.imwrite("other.png", simulate.render(SCENE, np.random.default_rng(13)))
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(Path("other.png").read_bytes())))
    code, out, _ = run("calibrate", "photo.png", "-", "--json")
    assert code == 0
    assert {plane["image"] for plane in json.loads(out)["planes"]} == {0, 1}


def test_folders_in_a_folder_are_not_searched_and_that_is_said(run, folder):
    Path("session/day").mkdir(parents=True)
    Path("photo.png").rename("session/day/photo.png")
    code, _, err = run("calibrate", "session")
    assert (code, err) == (
        5,
        "trisquare: error: session: the folder contains no picture; folders in it are not "
        "searched: name them, or all as 'session/**/*.jpg'\n",
    )
    assert run("calibrate", "session/**/*.png")[0] == 0
