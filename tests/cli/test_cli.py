"""The `trisquare` command: its output, its files, and its exit codes."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from command_errors import error_text

import trisquare.cli.calibrate
from trisquare import cli as commands
from trisquare import diagnose, errors, simulate
from trisquare.calibration.calibrate import Calibrated
from trisquare.drawing.overlay import draw_overlay
from trisquare.edges import PlaneEdges
from trisquare.measurement import measure
from trisquare.results.calibration import Calibration, Camera
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.plane import Plane
from trisquare.results.rejected import Rejected

SCENE = simulate.random_scene(np.random.default_rng(11), image_size=(640, 480))
PHOTO = simulate.render(SCENE, np.random.default_rng(12))
UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def true_calibration(images=1, warnings=()):
    """Return the result of a perfect calibration of the scene."""
    truth = SCENE.camera
    parameters = ("fx", "fy", "cx", "cy", "k1", "k2")
    planes = [
        Plane(
            kind="square",
            image=image,
            corners=SCENE.image_points(number, UNIT_SQUARE),
            rotation=target.rotation,
            translation=target.translation,
            rms=0.01,
            samples=300,
        )
        for image in range(images)
        for number, target in enumerate(SCENE.targets)
    ]
    return Calibration(
        camera=Camera(truth.K, truth.distortion, truth.image_size),
        std=dict.fromkeys(parameters, 0.1),
        covariance=np.eye(6) * 0.01,
        parameters=parameters,
        planes=tuple(planes),
        rms=0.01,
        noise_scale=1.0,
        warnings=tuple(warnings),
        method="ml",
        tone="srgb",
        fixed=(),
        stage="edges",
    )


def true_edges(*_, **__):
    rng = np.random.default_rng(13)
    return [PlaneEdges.square(sides) for sides in simulate.edge_points(SCENE, rng, noise=0.01)]


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), PHOTO)
    return path


@pytest.fixture
def asked(monkeypatch):
    """Replace the command's calibration by a finished one; return the arguments of its calls."""
    calls = []

    def calibrate_photographs(photographs, **options):
        calls.append((photographs.sources, options))
        return Calibrated(true_calibration(len(photographs), warnings=["a warning"]), ())

    monkeypatch.setattr(commands.calibrate, "calibrate_photographs", calibrate_photographs)
    return calls


def assert_refused(outcome, exit_code, folder, left=("photo.png",), *, as_json=False):
    """Check for one line on standard error, nothing on standard output, no file written."""
    code, out, err = outcome
    assert (code, out) == (exit_code, "")
    assert error_text(err, as_json=as_json)
    assert sorted(path.name for path in folder.iterdir()) == sorted(left)


# The command with a finished calibration.


def test_the_options_reach_the_library(run, photo, asked):
    code, _, err = run(
        *("calibrate", photo, "--model", "brown", "--method", "linear", "--tone", "2.2"),
        *("--fix", "aspect,focal", "--fix", "distortion", "--targets", "squares", "--lines"),
        *("--orthogonal", "0,1", "--orthogonal", "1,2", "--jobs", "3"),
        *("--side", "84mm"),
    )
    assert (code, err) == (0, "warning (medium): a warning [other]\n")
    photos, options = asked[0]
    assert photos == [photo]
    assert options == {
        **{"model": "brown", "method": "linear", "tone": 2.2, "targets": "squares"},
        **{"fix": ("aspect", "focal", "distortion"), "progress": None, "outlines": None},
        **{"initial": None, "free": (), "lines": True, "threads": 3},
        **{"explain": True, "explain_all": False},
        **{"orthogonal": [(0, 1), (1, 2)], "parallel": [], "side": "84mm"},
    }
    run("calibrate", photo, "--free", "skew", "--parallel", "0,2")
    assert asked[1][1] == {
        **{"model": "radial2", "method": "ml", "tone": None, "targets": "auto"},
        **{"fix": (), "progress": None, "outlines": None},
        **{"initial": None, "free": ("skew",), "lines": False, "threads": None},
        **{"explain": True, "explain_all": False},
        **{"orthogonal": [], "parallel": [(0, 2)], "side": None},
    }


def test_a_camera_to_hold_is_read_from_a_file(run, photo, asked, tmp_path):
    known = SCENE.camera
    Camera(known.K, known.distortion, known.image_size).save(tmp_path / "known.yaml")
    assert run("calibrate", photo, "--initial", tmp_path / "known.yaml", "--fix", "focal")[0] == 0
    assert asked[0][1]["fix"] == ("focal",)
    assert np.array_equal(asked[0][1]["initial"].K, known.K)


def test_what_is_held_has_the_values_of_the_file(run, photo, tmp_path):
    known = SCENE.camera
    held = Camera(known.K, known.distortion, known.image_size)
    held.save(tmp_path / "known.yaml")
    options = ("--initial", tmp_path / "known.yaml", "--fix", "focal,principal_point", "--json")
    code, out, err = run("calibrate", photo, *options)
    assert (code, err) == (0, "")
    found = Calibration.from_json(out)
    assert np.array_equal(found.camera.K, held.K)
    assert set(found.fixed) == {"focal", "principal_point"}
    half = held.rescaled((320, 240))
    half.save(tmp_path / "half.yaml")
    code, _, err = run("calibrate", photo, "--initial", tmp_path / "half.yaml")
    assert code == 2
    assert "320 x 240, these have 640 x 480" in err


def test_the_table_says_what_is_held_at_which_value(run, photo, tmp_path):
    """A distortion that is held without a file is zero, for any model."""
    _, out, _ = run("calibrate", photo, "--fix", "distortion,aspect", "--model", "brown")
    assert "model brown, method ml (edges), fixed: aspect at 1; distortion at zero: rms" in out
    known = SCENE.camera
    Camera(known.K, known.distortion, known.image_size).save(tmp_path / "known.json")
    options = ("--initial", tmp_path / "known.json", "--fix", "focal,principal_point,distortion")
    _, out, _ = run("calibrate", photo, *options)
    bent = ", ".join(f"k{i} {value:.6g}" for i, value in enumerate(known.distortion[:2], 1))
    assert (
        f"fixed: principal point at ({known.cx:.6g}, {known.cy:.6g}); focal length at "
        f"fx {known.fx:.6g}, fy {known.fy:.6g}; distortion at {bent}: rms"
    ) in out


def test_a_focal_length_needs_a_file_to_be_held_at(run, photo, tmp_path):
    outcome = run("calibrate", photo, "--fix", "focal", "-o", tmp_path / "camera.json")
    assert_refused(outcome, 2, tmp_path)
    assert outcome[2].endswith("give its value by a camera: --initial\n")


def test_the_table_shows_numbers_planes_and_warnings(run, photo, asked):
    code, out, err = run("calibrate", photo)
    assert (code, err, len(asked)) == (0, "warning (medium): a warning [other]\n", 1)
    assert "\x1b" not in out
    shown = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.split()}
    for name, value in (("fx", SCENE.camera.fx), ("cy", SCENE.camera.cy)):
        assert shown[name] == ["px", f"{value:.2f}", "0.10"]
    assert "px" not in shown["k1"]
    assert "distance sides   tilt deg   rms px" in out
    assert shown["2"][:2] == ["square", "0"]
    assert "warning" not in out


def test_what_a_message_advises_is_written_as_an_option(run, photo, monkeypatch):
    advice = CalibrationWarning('With fix="principal_point", fx is 1', "other")
    unused = Rejected("quad", 0, np.zeros((4, 2)), 'found by targets="rectangle:1"')
    done = Calibrated(replace(true_calibration(warnings=(advice,)), rejected=(unused,)), ())
    monkeypatch.setattr(commands.calibrate, "calibrate_photographs", lambda *_, **__: done)
    _, out, err = run("calibrate", photo)
    assert err == "warning (medium): With --fix principal_point, fx is 1 [other]\n"
    assert "found by --targets rectangle:1\n" in out
    _, _, err = run("calibrate", photo, "--board", "chessboard:9x6")
    assert error_text(err) == (
        "a board without markers is not a layout: give --targets chessboard:9x6\n"
    )


def test_texts_of_a_result_do_not_reach_a_terminal_as_they_are(run, photo, monkeypatch):
    """These texts include names of marker sheets and of files."""
    hostile = "a\x1b[31m\u202eb\x9b2J\nwrote all"
    corners = np.zeros((4, 2))
    result = true_calibration(warnings=(CalibrationWarning("\x1b[2Jb\nc", "other"),))
    result = replace(
        result,
        planes=tuple(replace(plane, kind=hostile) for plane in result.planes),
        rejected=(Rejected(hostile, 0, corners, hostile),),
        stage=hostile,
    )
    done = Calibrated(result, ())
    monkeypatch.setattr(commands.calibrate, "calibrate_photographs", lambda *_, **__: done)
    code, out, err = run("calibrate", photo, "--verbose")
    assert code == 0
    shown = r"a\x1b[31m\u202eb\x9b2J\nwrote all"
    assert out.count(r"a\x1b[31m") == len(result.planes) + 3
    assert f"method ml ({shown})" in out
    assert f"not used: {shown} around (0, 0) of picture 0: {shown}" in out
    assert r"warning (medium): \x1b[2Jb\nc [other]" in err
    for text in (out, err):
        assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", text)
        assert not re.search("^ *wrote all", text, re.MULTILINE)


def test_json_alone_stands_on_standard_output(run, photo, asked):
    code, out, err = run("calibrate", photo, "--json")
    assert (code, err, len(asked)) == (0, "", 1)
    assert Calibration.from_json(out).to_json() == out


def test_files_are_written(run, photo, asked, tmp_path):
    camera, overlay = tmp_path / "camera.json", tmp_path / "overlay.png"
    code, out, _ = run("calibrate", photo, "--json", "-o", camera, "--overlay", overlay)
    assert (code, len(asked)) == (0, 1)
    assert camera.read_text() == out
    drawn = cv2.imread(str(overlay))
    assert drawn.shape == (*PHOTO.shape[:2], 3)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"photo.png", "camera.json", "overlay.png"}


def test_several_photographs_have_an_overlay_each(run, photo, asked, tmp_path):
    again = tmp_path / "again.png"
    again.write_bytes(photo.read_bytes())
    code, _, err = run("calibrate", photo, again, "--overlay", tmp_path / "over.png")
    assert (code, err) == (0, "warning (medium): a warning [other]\n")
    assert asked[0][0] == [photo, again]
    calibration = true_calibration(2, warnings=["a warning"])
    for index in (0, 1):
        drawn = draw_overlay(PHOTO, calibration, index=index)
        written = cv2.imread(str(tmp_path / f"over-{index + 1}.png"))
        np.testing.assert_array_equal(written, drawn)
    assert not (tmp_path / "over.png").exists()


@pytest.mark.parametrize("outcome", ["answered", "refused"])
def test_a_photograph_is_decoded_and_searched_once(run, tmp_path, monkeypatch, outcome):
    """Whatever is drawn from it: overlay, report, debug picture and diagnosis."""
    decoded, searched = [], []
    decode, search = cv2.imdecode, measure.search
    monkeypatch.setattr(cv2, "imdecode", lambda *a: decoded.append(a) or decode(*a))
    monkeypatch.setattr(measure, "search", lambda *a: searched.append(a) or search(*a))
    photo = tmp_path / "photo.png"
    picture = simulate.render(SCENE, np.random.default_rng(1), noise=1.0)
    if outcome == "refused":
        picture[:, : picture.shape[1] // 2] = picture.max()
    cv2.imwrite(str(photo), picture)
    outputs = [tmp_path / name for name in ("c.json", "over.png", "debug.png", "report.html")]
    options = ("-o", "--overlay", "--debug-image", "--report")
    pairs = [word for pair in zip(options, outputs, strict=True) for word in pair]
    code, _, _ = run("calibrate", photo, *pairs, "--diagnose")
    assert (code == 0) == (outcome == "answered")
    assert (len(decoded), len(searched)) == (1, 1)
    assert outputs[2].exists()


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        (ValueError("no such model"), 2),
        (TypeError("wrong type"), 2),
        (errors.DetectionError("nothing\nfound"), 3),
        (errors.NotEnoughPlanesError("two planes"), 3),
        (errors.NotEnoughDataError("few samples"), 3),
        (errors.DegenerateGeometryError("parallel"), 4),
        (errors.ConvergenceError("no minimum"), 4),
        (errors.ImageError("photo.png: truncated"), 5),
    ],
)
def test_every_error_has_its_exit_code(run, photo, tmp_path, monkeypatch, error, exit_code):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(commands.calibrate, "calibrate_photographs", fail)
    outcome = run("calibrate", photo, "-o", tmp_path / "camera.json", "--json")
    assert_refused(outcome, exit_code, tmp_path, as_json=True)
    assert json.loads(outcome[2])["error"] == {
        **{"code": type(error).__name__, "text": " ".join(str(error).split())},
        "exit_code": exit_code,
        "help": f"faq.html#{type(error).__name__.lower()}",
    }


@pytest.mark.parametrize("json_asked", [(), ("--json",)])
def test_a_failing_overlay_does_not_lose_the_rest(
    run, photo, asked, tmp_path, monkeypatch, json_asked
):
    def fail(*_, **__):
        raise ValueError("point 0 is beyond the valid radius")

    monkeypatch.setattr(commands.calibrate, "draw_overlay", fail)
    camera, found = tmp_path / "camera.json", tmp_path / "found.png"
    outputs = ("-o", camera, "--overlay", tmp_path / "overlay.png", "--debug-image", found)
    code, out, err = run("calibrate", photo, *outputs, *json_asked)
    assert (code, len(asked)) == (2, 1)
    error = err.splitlines()[-1] + "\n"
    text = error_text(error, as_json=bool(json_asked))
    assert text.strip() == "point 0 is beyond the valid radius"
    result = Calibration.from_json(camera.read_text())
    if json_asked:
        assert Calibration.from_json(out) == result
    else:
        assert f"wrote {camera}\nwrote {found}\n" in out
    assert {path.name for path in tmp_path.iterdir()} == {"photo.png", "camera.json", "found.png"}


def test_the_format_of_a_camera_alone_is_named(run, photo, asked, tmp_path):
    for name, more in (
        ("camera.json", ""),
        ("cameras.txt", " (colmap: the camera alone)"),
        ("camera.yaml", " (opencv: the camera alone)"),
    ):
        code, out, _ = run("calibrate", photo, "-o", tmp_path / name)
        assert code == 0
        assert out.endswith(f"wrote {tmp_path / name}{more}\n")
    code, out, err = run("calibrate", photo, "-o", tmp_path / "camera.png")
    assert (code, out) == (2, "")
    assert "'camera.png' determines no camera format: let it end with .json" in err
    assert "camera_info.yaml" in err
    assert "--to" not in err


@pytest.mark.parametrize(
    "outputs",
    [
        ["-o", "missing/camera.json"],
        ["--overlay", "missing/overlay.png"],
        ["-o", "."],
        ["-o", "photo.png"],
        ["--overlay", "photo.png"],
        ["--overlay", "overlay.xyz"],
        ["--overlay", "overlay"],
        ["-o", "same.png", "--overlay", "same.png"],
    ],
    ids=" ".join,
)
def test_impossible_outputs_are_refused_before_any_work(run, photo, asked, tmp_path, outputs):
    before = photo.read_bytes()
    arguments = [arg if arg.startswith("-") and arg != "-" else tmp_path / arg for arg in outputs]
    assert_refused(run("calibrate", photo, *arguments), 2, tmp_path)
    assert asked == []
    assert photo.read_bytes() == before


@pytest.mark.parametrize(
    "arguments",
    [["calibrate"], ["calibrate", "photo.png", "--wrong"], ["wrong"], ["calibrate", "-o"]],
    ids=" ".join,
)
def test_wrong_usage_is_one_line(run, tmp_path, arguments):
    assert_refused(run(*arguments), 2, tmp_path, left=())


def test_version_and_help(run):
    code, out, err = run()
    assert (code, err) == (0, "")
    assert out == run("--help")[1]
    code, out, _ = run("--version")
    assert (code, out.split()[0]) == (0, "trisquare")
    code, out, _ = run("calibrate", "--help")
    assert code == 0
    for option in ("--output", "--json", "--overlay", "--model", "--method", "--fix", "--tone"):
        assert option in out


# End to end, with nothing replaced.


def trisquare(*arguments, folder):
    """Run the installed command in a process of its own."""
    command = [sys.executable, "-c", "from trisquare.cli import main; main()"]
    return subprocess.run(
        [*command, *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=False
    )


def test_a_photograph_is_calibrated(photo, tmp_path):
    arguments = ("photo.png", "-o", "camera.json", "--json", "--overlay", "overlay.png")
    done = trisquare("calibrate", *arguments, "--tone", "linear", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    result = Calibration.from_json(done.stdout)
    assert (tmp_path / "camera.json").read_text() == done.stdout
    assert cv2.imread(str(tmp_path / "overlay.png")).shape == (*PHOTO.shape[:2], 3)
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(SCENE.camera, name)
        assert abs(error) < 4 * result.std[name]


def test_the_demo_shows_the_truth(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run("demo", "--output", "results")
    assert (code, err) == (0, "")
    result = Calibration.from_json((tmp_path / "results" / "camera.json").read_text())
    names = ["photo.png", "camera.json", "overlay.png", "report.html"]
    told, next_steps = out.split("next:\n")
    assert told.endswith("".join(f"wrote results/{name}\n" for name in names))
    overlay, photo = (cv2.imread(str(tmp_path / "results" / name)) for name in names[2::-2])
    assert overlay.shape == photo.shape
    assert "photo.png" in (tmp_path / "results" / "report.html").read_text()
    rows = [line.split() for line in out.splitlines() if line.split()]
    shown = {row[0]: list(map(float, row[-5:])) for row in rows if row[0] in result.std}
    assert set(shown) == set(result.std)
    for estimate, std, truth, _, _ in shown.values():
        assert abs(estimate - truth) < 4 * std
    lines = [line.split() for line in next_steps.splitlines()]
    undistort, measure = (line[1:] for line in lines[:2])
    assert run(*undistort)[0] == 0
    assert (tmp_path / "results" / "straight.png").exists()
    members = json.loads(run(*measure, "--json")[1])
    (true,) = re.findall(r"([\d.]+) mm is the truth", next_steps)
    assert abs(members["lengths"][0] - float(true)) < members["lengths_std"][0]


@pytest.mark.parametrize("content", [None, b"", b"no picture"], ids=["missing", "empty", "text"])
def test_an_unreadable_photograph_exits_5(run, tmp_path, content):
    if content is not None:
        (tmp_path / "photo.png").write_bytes(content)
    left = () if content is None else ("photo.png",)
    outcome = run("calibrate", tmp_path / "photo.png", "-o", tmp_path / "camera.json")
    assert_refused(outcome, 5, tmp_path, left)


def test_a_truncated_photograph_exits_5(photo, tmp_path):
    photo.write_bytes(photo.read_bytes()[:-100])
    done = trisquare("calibrate", "photo.png", "-o", "camera.json", folder=tmp_path)
    assert_refused((done.returncode, done.stdout, done.stderr), 5, tmp_path)


def test_a_photograph_of_nothing_exits_3(run, photo, tmp_path):
    cv2.imwrite(str(photo), np.full((480, 640), 128, np.uint8))
    assert_refused(run("calibrate", photo, "-o", tmp_path / "camera.json"), 3, tmp_path)


@pytest.mark.parametrize(
    "option",
    [
        ("--model", "fishy"),
        ("--method", "magic"),
        ("--fix", "everything"),
        ("--tone", "warm"),
        ("--tone", "nan"),
        ("--tone", "-1"),
        ("--targets", "chessboard"),
    ],
    ids=" ".join,
)
def test_wrong_option_values_exit_2(run, photo, tmp_path, option):
    outcome = run("calibrate", photo, "-o", tmp_path / "camera.json", *option)
    assert_refused(outcome, 2, tmp_path)


@pytest.mark.parametrize(
    "arguments",
    [
        ("calibrate", "photo.png", "--board", "given.json"),
        ("calibrate", "photo.png", "--outline", "given.json"),
        ("predict", "given.json"),
        ("predict", "--camera", "given.json"),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("content", [None, b"", b"\xff\xfe", b"[]"])
def test_a_file_that_is_wrong_is_named_first(run, photo, tmp_path, monkeypatch, arguments, content):
    monkeypatch.chdir(tmp_path)
    left = ["photo.png"]
    if content is not None:
        (tmp_path / "given.json").write_bytes(content)
        left.append("given.json")
    outcome = run(*arguments)
    assert_refused(outcome, 5 if content is None else 2, tmp_path, left)
    assert outcome[2].startswith("trisquare: error: given.json: ")


def test_json_is_the_library_s(run, photo):
    code, out, err = run("calibrate", photo, "--json", "--tone", "linear")
    assert (code, err) == (0, "")
    members = json.loads(out)
    assert members["tone"] == "linear"
    assert members["image_size"] == list(SCENE.camera.image_size)
    assert len(members["planes"]) == len(SCENE.targets)


def test_diagnosis_follows_the_tables(run, asked, photo):
    code, out, error = run("calibrate", photo, "--diagnose")
    assert (code, error) == (0, "warning (medium): a warning [other]\n")
    assert "fx  std 0.1: " in out
    assert "would reduce it from 0.1 to" in out
    code, _, error = run("calibrate", photo, "--diagnose", "--quiet")
    assert (code, "--quiet" in error) == (2, True)


def test_a_diagnosis_is_a_member_of_the_json(run, asked, photo, tmp_path):
    code, out, error = run("calibrate", photo, "--diagnose", "--json", "-o", tmp_path / "c.json")
    assert (code, error) == (0, "")
    members = json.loads(out)
    result = Calibration.from_json(out)
    assert members.pop("diagnosis") == diagnose(result).members()
    assert json.loads((tmp_path / "c.json").read_text()) == members


@pytest.mark.parametrize("size", ["1280x960", "960x1280", "1080x1920", "960x960"])
@pytest.mark.parametrize("focal", [0.7, 1.2])
def test_squares_are_planned_whichever_way_up_the_picture_is(run, size, focal):
    pixels = focal * min(map(int, size.split("x")))
    code, out, err = run("predict", "--size", size, "--focal", pixels, "--json")
    assert (code, err) == (0, "")
    assert len(json.loads(out)["squares"]) == 3
