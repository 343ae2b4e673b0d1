"""Bad input causes the documented error, in Python and in the command, and leaves no file."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import IMAGE_SIZE, camera_of, edges_of, parallel_squares, squares

import trisquare as ts
from trisquare import simulate

SCENE = squares(51)
EDGES = edges_of(SCENE, 0.05)
PINHOLE = simulate.TrueCamera(1000.0, 1000.0, 639.5, 479.5)
SIDES = [np.array(points) for points in EDGES[0].points]
ENCODED = cv2.imencode(".png", simulate.render(SCENE, np.random.default_rng(52)))[1].tobytes()
INITIAL = camera_of(SCENE)


def thinned(figures, count):
    """The same figures with `count` samples per side."""
    return [
        ts.PlaneEdges(f.lines, [p[np.linspace(0, len(p) - 1, count).astype(int)] for p in f.points])
        for f in figures
    ]


def changed(value, row=3, column=0):
    sides = [side.copy() for side in SIDES]
    sides[2][row, column] = value
    return sides


def solve(figures=EDGES, size=IMAGE_SIZE, **options):
    return ts.calibrate_edges(figures, size, **options)


# Coordinates.


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: ts.PlaneEdges.square(changed(np.nan)), ValueError, "NaN"),
        (lambda: ts.PlaneEdges.square(changed(-np.inf)), ValueError, "infinite"),
        (lambda: ts.PlaneEdges.square(changed(1e300)), ValueError, "beyond"),
        (lambda: ts.PlaneEdges.square([s[:, :1] for s in SIDES]), ValueError, "shape"),
        (lambda: ts.PlaneEdges.square([*SIDES, *SIDES]), ValueError, "a frame is two squares"),
        (lambda: ts.PlaneEdges.square([s.astype(str) for s in SIDES]), TypeError, "real numbers"),
        (lambda: ts.PlaneEdges.square([s.astype(complex) for s in SIDES]), TypeError, "complex"),
        (lambda: ts.PlaneEdges.square([s > 0 for s in SIDES]), TypeError, "bool"),
        (lambda: ts.PlaneEdges.square(None), TypeError, None),
        (lambda: ts.PlaneEdges.square(SIDES[:3]), ts.NotEnoughDataError, "4 sides"),
        (lambda: ts.PlaneEdges.square([*SIDES, SIDES[0]]), ValueError, "4"),
        (lambda: ts.PlaneEdges.square([s[:1] for s in SIDES]), ts.NotEnoughDataError, "2"),
        (lambda: ts.PlaneEdges.square([s[:0] for s in SIDES]), ts.NotEnoughDataError, "empty"),
        (lambda: ts.PlaneEdges.square([SIDES[i] for i in (0, 2, 1, 3)]), ValueError, "order"),
        (lambda: ts.PlaneEdges(np.eye(3)[:3], SIDES[:3]), ts.NotEnoughDataError, "4 lines"),
        (lambda: ts.PlaneEdges(EDGES[0].lines, SIDES[:3]), ValueError, "one per line"),
        (lambda: solve([]), ts.NotEnoughPlanesError, "0 plane"),
        (lambda: solve(EDGES[:1]), ts.NotEnoughPlanesError, "1 plane"),
        (lambda: solve(EDGES[:1], fix=["aspect"]), ts.NotEnoughPlanesError, "1 plane"),
        (lambda: solve(thinned(EDGES, 2)), ts.NotEnoughDataError, "24 samples"),
        (
            lambda: solve(edges_of(parallel_squares(PINHOLE))),
            ts.DegenerateGeometryError,
            "parallel",
        ),
        (
            lambda: solve(edges_of(parallel_squares(PINHOLE), 0.05), method="linear"),
            ts.TrisquareError,
            None,
        ),
        (
            lambda: solve(edges_of(parallel_squares(PINHOLE, (0, 0, 0.3))), fix="principal_point"),
            ts.DegenerateGeometryError,
            None,
        ),
        (lambda: solve([EDGES[0], "edges"]), TypeError, "a list of PlaneEdges, .*, not of str"),
        (lambda: solve(EDGES[0]), TypeError, "a list of PlaneEdges, .*, not a single PlaneEdges"),
        (lambda: solve(size=(1280,)), ValueError, None),
        (lambda: solve(size=1280), TypeError, None),
        (lambda: solve(size=(1280, -960)), ValueError, "positive"),
        (lambda: solve(size=(1280, 2**40)), ValueError, "at most"),
        (lambda: ts.PlaneEdges(EDGES[0].lines, SIDES, image=2**70), ValueError, "image"),
        (lambda: ts.PlaneEdges(EDGES[0].lines, SIDES, image=-1), ValueError, "image"),
        (lambda: solve(size=(1280.0, 960)), TypeError, r"image_size\[0\] must be a whole number"),
        (lambda: solve(model="fishy"), ValueError, "fishy"),
        (lambda: solve(model=2), TypeError, "model"),
        (lambda: solve(method="magic"), ValueError, "magic"),
        (lambda: solve(fix="everything"), ValueError, "everything"),
        (lambda: solve(fix=3), TypeError, "fix takes names, such as 'aspect', not int"),
        (lambda: solve(free=None), TypeError, "free takes names, .* not NoneType"),
        (lambda: solve(orthogonal=5), TypeError, "orthogonal takes pairs, .* not int"),
        (lambda: solve(fix="focal"), ValueError, "initial"),
        (lambda: solve(initial=INITIAL.K), TypeError, "Camera"),
        (lambda: solve(initial="known.json"), TypeError, r"not str: read a file by Camera\.load"),
        (
            lambda: solve(size=(640, 480), initial=INITIAL),
            ValueError,
            "initial camera is for pictures of",
        ),
    ],
)
def test_coordinates_that_cannot_be_used(call, error, message):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize("bad", [None, 5])
@pytest.mark.parametrize(
    ("call", "name"),
    [
        (solve, "edges"),
        (lambda bad: ts.predict(INITIAL, bad), "planes"),
        (lambda bad: ts.calibrate(ENCODED, progress=bad or "no"), "progress"),
        (lambda bad: ts.write_report(solve(), bad), "path"),
        (ts.camera_matrix_from_homographies, "homographies"),
        (lambda bad: ts.fit_distortion(bad, IMAGE_SIZE), "curves"),
        (ts.PlaneEdges.square, "sides"),
        (ts.PlaneEdges.circles, "points"),
        (lambda bad: ts.PlaneEdges.circles(SIDES[:1], bad or "no"), "radii"),
        (lambda bad: ts.PlaneEdges.families(bad, SIDES[:2]), "along_x"),
        (lambda bad: replace(solve(), edges=bad), "edges"),
    ],
)
def test_a_type_error_names_the_argument(call, name, bad):
    with pytest.raises(TypeError, match=f"^{name} must be .*, not (NoneType|int|str)$"):
        call(bad)


def test_two_parallel_squares_do_not_count_twice():
    """The third square would give a second direction, which a pinhole's four parameters need."""
    scene = parallel_squares(PINHOLE)
    with pytest.raises(ts.DegenerateGeometryError):
        solve(edges_of(simulate.Scene(PINHOLE, scene.targets[:2]), 0.05))


def test_figures_of_one_plane_are_one_plane():
    """However many figures there are, one direction is not enough."""
    frames = edges_of(squares(53, kind="frame"), 0.05)
    with pytest.raises(ts.NotEnoughPlanesError, match="1 plane"):
        solve(frames[:2])


# Pictures.


@pytest.mark.parametrize(
    ("image", "error"),
    [
        (np.zeros((1, 1), np.uint8), ts.DetectionError),
        (np.zeros((480, 640), np.uint8), ts.DetectionError),
        (np.zeros((480, 640, 3), np.uint8), ts.DetectionError),
        (np.full((480, 640), 255, np.uint8), ts.DetectionError),
        (np.zeros((1, 2000), np.float32), ts.DetectionError),
        (np.full((480, 640), np.nan, np.float32), ValueError),
        (np.full((480, 640), np.inf, np.float32), ValueError),
        (np.zeros((0, 640), np.uint8), ValueError),
        (np.zeros(640, np.uint8), ValueError),
        (np.zeros((480, 640, 4), np.uint8), ts.DetectionError),
        (np.zeros((480, 640, 5), np.uint8), ValueError),
        (np.zeros((480, 640), np.float64), TypeError),
        (np.zeros((480, 640), bool), TypeError),
        (np.zeros((480, 640), np.int16), TypeError),
        (None, TypeError),
        (3, TypeError),
        (b"photo.png", ts.ImageError),
        ([], ValueError),
        ("no such file.png", ts.ImageError),
    ],
)
def test_what_is_no_picture_of_squares(image, error):
    with pytest.raises(error):
        ts.calibrate(image)


def test_a_folder_without_pictures_is_told(tmp_path):
    with pytest.raises(ts.ImageError, match="the folder contains no picture"):
        ts.calibrate(tmp_path)


NAME = "a\nb\x1b[31m"
CAMERA = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), (1280, 960))


@pytest.mark.parametrize(
    "call",
    [
        lambda: ts.calibrate("missing" + NAME),
        lambda: ts.calibrate([f"{NAME}.jpg", f"{NAME}.jpg"]),
        lambda: ts.calibrate(NAME),
        lambda: ts.calibrate(np.zeros((480, 640), np.uint8), outlines=f"{NAME}.json"),
        lambda: ts.read_image(f"{NAME}.jpg"),
        lambda: list(ts.find_jobs(["missing" + NAME])),
        lambda: ts.Camera.load(f"{NAME}.json"),
        lambda: ts.Calibration.load("missing" + NAME),
        lambda: CAMERA.save(f"{NAME}/folder/camera.json"),
        lambda: ts.write_report(None, f"{NAME}/folder/page.html"),
    ],
)
@pytest.mark.skipif(os.name != "posix", reason="names of files hold no such characters")
def test_names_in_messages_are_in_one_line(tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    Path(f"{NAME}.jpg").write_bytes(b"no picture")
    Path(f"{NAME}.json").write_text("{}")
    Path(NAME).mkdir()
    with pytest.raises((ts.ImageError, ValueError, OSError)) as raised:
        call()
    assert "a\\nb\\x1b[31m" in str(raised.value)
    assert str(raised.value).isprintable()


@pytest.mark.parametrize(
    ("level", "said"),
    [
        (0, "nearly black, with grey levels from 1 to 5 of 255"),
        (245, "nearly white"),
        (120, "uniform"),
    ],
)
def test_a_picture_without_contrast_is_called_that(level, said):
    noise = np.random.default_rng(3).integers(0, 7, (480, 640))
    picture = (level + noise).astype(np.uint8)
    sixteen_bits = 257 * picture.astype(np.uint16)
    sixteen_bits[0, 0] = 65535  # otherwise it may have 12 bits
    for each in (picture, sixteen_bits, picture.astype(np.float32) / 255):
        for search in (ts.calibrate, ts.detect):
            with pytest.raises(ts.DetectionError, match=said):
                search(each)


def test_one_of_two_pictures_without_contrast_is_no_reason():
    black = np.zeros((480, 640), np.uint8)
    noise = np.random.default_rng(3).integers(0, 255, (480, 640), dtype=np.uint8)
    for pictures in ([black, noise], [noise, black]):
        with pytest.raises(ts.DetectionError, match=r"^no square"):
            ts.calibrate(pictures)


def test_nothing_is_found_in_pictures_of_two_sizes():
    """The pictures of the less frequent size come first."""
    sizes = [(480, 640)] * 4 + [(500, 700)] * 5
    pictures = [np.full(size, number, np.uint8) for number, size in enumerate(sizes)]
    with pytest.raises(ts.DetectionError, match="no square"):
        ts.calibrate(pictures)


@pytest.mark.slow
def test_noise_alone_shows_no_squares():
    noise = np.random.default_rng(54).integers(0, 256, (480, 640), dtype=np.uint8)
    with pytest.raises(ts.DetectionError):
        ts.calibrate(noise)
    with pytest.raises(ts.DetectionError, match="9 x 6"):
        ts.calibrate(noise, targets="chessboard:9x6")


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"tone": "warm"}, ValueError),
        ({"tone": -1.0}, ValueError),
        ({"tone": np.nan}, ValueError),
        ({"tone": True}, TypeError),
        ({"tone": [1.0]}, TypeError),
        ({"targets": "circles"}, ValueError),
        ({"targets": "chessboard:1x1"}, ValueError),
        ({"targets": None}, TypeError),
    ],
)
def test_options_of_pictures(options, error):
    with pytest.raises(error):
        ts.detect(np.zeros((48, 64), np.uint8), **options)
    with pytest.raises(error):
        ts.calibrate(np.zeros((48, 64), np.uint8), **options)


def test_pictures_of_one_camera_have_one_size_and_depth():
    photo = simulate.render(SCENE, np.random.default_rng(52))
    with pytest.raises(ValueError, match="same size"):
        ts.calibrate([photo, photo[:-1]])
    with pytest.raises(ValueError, match="tone"):
        ts.calibrate([photo, photo.astype(np.uint16) * 257])


# The command.


def picture_of(scene):
    return cv2.imencode(".png", simulate.render(scene, np.random.default_rng(55)))[1].tobytes()


def blank(height, width, level):
    return cv2.imencode(".png", np.full((height, width), level, np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    ("content", "exit_code"),
    [
        (lambda: None, 5),
        (lambda: b"", 5),
        (lambda: b"%PDF-1.7 no picture", 5),
        (lambda: ENCODED[: len(ENCODED) // 2], 5),
        (lambda: ENCODED[:40], 5),
        (lambda: blank(1, 1, 128), 3),
        (lambda: blank(480, 640, 0), 3),
        (lambda: picture_of(squares(56, PINHOLE, count=1)), 3),
        (lambda: picture_of(parallel_squares(PINHOLE)), 4),
    ],
    ids=["missing", "empty", "other", "half", "head", "1x1", "black", "one square", "parallel"],
)
def test_the_command_refuses_bad_photographs(run, tmp_path, content, exit_code):
    photo, camera, overlay = (tmp_path / name for name in ("a.png", "camera.json", "over.png"))
    if (encoded := content()) is not None:
        photo.write_bytes(encoded)
    camera.write_text("kept")
    code, out, err = run("calibrate", photo, "-o", camera, "--overlay", overlay, "--json")
    assert (code, out, err.count("\n")) == (exit_code, "", 1)
    assert json.loads(err)["error"]["exit_code"] == exit_code
    assert camera.read_text() == "kept"
    assert {path.name for path in tmp_path.iterdir()} <= {"a.png", "camera.json"}


def test_an_old_output_is_replaced_by_a_complete_one(run, tmp_path):
    photo, camera = tmp_path / "a.png", tmp_path / "camera.json"
    photo.write_bytes(ENCODED)
    camera.write_text("old " * 10000)
    code, out, _ = run("calibrate", photo, "-o", camera, "--json")
    assert code == 0
    assert camera.read_text() == out
    assert ts.Calibration.from_json(out).to_json() == out


def test_a_folder_that_is_none_is_found_out_first(run, tmp_path):
    (tmp_path / "a.png").write_bytes(ENCODED)
    for where in ("missing/camera.json", "a.png/camera.json"):
        code, out, err = run("calibrate", tmp_path / "a.png", "-o", tmp_path / where)
        assert (code, out, err.count("\n")) == (2, "", 1)
    assert (tmp_path / "a.png").read_bytes() == ENCODED


@pytest.mark.slow
def test_nothing_is_warned_of(tmp_path):
    """With every Python warning turned into an error, and nothing on standard error."""
    (tmp_path / "a.png").write_bytes(ENCODED)
    script = "from trisquare.cli import main; main(['calibrate', 'a.png', '--overlay', 'o.png'])"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
