"""Common properties of all commands: help, options, output, errors and exit codes.

A new command has to be added to the tables below; the first test checks this.
"""

import importlib
import inspect
import json
import os
import pkgutil
import re
import shlex
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_errors import error_text
from plumb_scenes import plumb_scene
from scenes import edges_of, squares
from terminals import COMMAND, on_terminal

import trisquare as ts
from trisquare import cli as commands
from trisquare import simulate
from trisquare.cli.framework import ELSEWHERE, EXIT_CODES_HELP, SUMMARIES, load_command

IMAGE_SIZE = (640, 480)
SCENE = squares(11, image_size=IMAGE_SIZE)
CALIBRATION = ts.calibrate_edges(edges_of(SCENE), IMAGE_SIZE)
PHOTO = simulate.render(SCENE, np.random.default_rng(12))
FIRST, SECOND = (
    "{:.0f},{:.0f}".format(*corner)
    for corner in SCENE.image_points(0, np.array([[-0.5, -0.5], [0.5, -0.5]]))
)
FORMATS_PAGE = Path(__file__).parents[2] / "docs" / "formats.md"
TAKEN = ("photo.png", "--camera", "camera.json")

WORKING = {
    "calibrate": ("photo.png",),
    "batch": ("photo.png", "-o", "results"),
    "serve": ("--port", "0", "--idle", "0.1", "--token", "0123456789abcdef"),
    "predict": ("--size", "640x480"),
    "measure": (*TAKEN, FIRST, SECOND),
    "compare": ("camera.json", "camera.json"),
    "target": ("-o", "target.pdf"),
    "undistort": (*TAKEN, "-o", "out.png"),
    "straighten": ("lines.png", "-o", "out.png"),
    "convert": ("camera.json", "out.yaml"),
    "demo": ("-o", "results"),
}
"""Arguments with which each command runs successfully."""

PICTURES_READ = (
    ("calibrate", "GIVEN"),
    ("calibrate", "photo.png", "GIVEN"),
    ("measure", "GIVEN", "--camera", "camera.json", FIRST, SECOND),
    ("undistort", "GIVEN", "--camera", "camera.json", "-o", "out.png"),
    ("straighten", "GIVEN", "-o", "out.png"),
    ("target", "--check", "GIVEN"),
)
FILES_READ = (
    ("calibrate", "photo.png", "--outline", "GIVEN"),
    ("calibrate", "photo.png", "--board", "GIVEN"),
    ("calibrate", "photo.png", "--initial", "GIVEN"),
    ("batch", "photo.png", "-o", "results", "--initial", "GIVEN"),
    ("predict", "GIVEN"),
    ("predict", "--camera", "GIVEN"),
    ("measure", "photo.png", "--camera", "GIVEN", FIRST, SECOND),
    ("batch", "photo.png", "-o", "results", "--limits", "GIVEN"),
    ("serve", "--certificate", "GIVEN", "--key", "GIVEN"),
    ("measure", *TAKEN, "--outline", "GIVEN", FIRST, SECOND),
    ("measure", *TAKEN, "--targets", "GIVEN", FIRST, SECOND),
    ("compare", "GIVEN", "camera.json"),
    ("compare", "camera.json", "GIVEN"),
    ("undistort", "photo.png", "--camera", "GIVEN", "-o", "out.png"),
    ("convert", "GIVEN", "out.yaml"),
)
WRITTEN = (
    ("calibrate", "photo.png", "-o", "OUT.json"),
    ("calibrate", "photo.png", "--report", "OUT.html"),
    ("calibrate", "photo.png", "--overlay", "OUT.png"),
    ("calibrate", "photo.png", "--debug-image", "OUT.png"),
    ("measure", *TAKEN, "--rectify", "OUT.png"),
    ("compare", "camera.json", "camera.json", "--map", "OUT.png"),
    ("target", "-o", "OUT.pdf"),
    ("undistort", *TAKEN, "-o", "OUT.png"),
    ("straighten", "lines.png", "-o", "OUT.png"),
    ("straighten", "lines.png", "-o", "new.png", "--overlay", "OUT.png"),
    ("straighten", "lines.png", "-o", "new.png", "--focal", "900", "--save-camera", "OUT.json"),
    ("convert", "camera.json", "OUT.yaml"),
)
OVERWRITING = (
    ("calibrate", "photo.png", "-o", "photo.png"),
    ("calibrate", "photo.png", "-o", "./photo.png"),
    ("calibrate", "photo.png", "--report", "photo.png"),
    ("calibrate", "photo.png", "-o", "link.png"),
    ("calibrate", "photo.png", "--overlay", "photo.png"),
    ("calibrate", "photo.png", "--debug-image", "photo.png"),
    ("calibrate", "photo.png", "-o", "new.png", "--overlay", "new.png"),
    ("calibrate", "photo.png", "--outline", "camera.json", "-o", "camera.json"),
    ("calibrate", "photo.png", "--board", "camera.json", "-o", "camera.json"),
    ("calibrate", "photo.png", "--initial", "camera.json", "-o", "camera.json"),
    ("measure", *TAKEN, "--rectify", "photo.png"),
    ("compare", "camera.json", "photo.png", "--map", "photo.png"),
    ("undistort", *TAKEN, "-o", "photo.png"),
    ("undistort", *TAKEN, "-o", "."),
    ("undistort", "photo.png", "--camera", "link.png", "-o", "photo.png"),
    ("straighten", "photo.png", "-o", "photo.png"),
    ("straighten", "photo.png", "-o", "new.png", "--overlay", "new.png"),
    ("straighten", "photo.png", "-o", "new.png", "--focal", "900", "--save-camera", "photo.png"),
    ("convert", "camera.json", "camera.json"),
    ("convert", "camera.json", "./camera.json", "--to", "ros"),
    ("demo", "-o", "photo.png"),
)


@pytest.fixture(scope="module")
def files():
    """The contents of the files in each test's folder."""
    straight = plumb_scene(np.random.default_rng(3), IMAGE_SIZE, -0.15).picture
    photo, lines = (cv2.imencode(".png", picture)[1].tobytes() for picture in (PHOTO, straight))
    camera = CALIBRATION.to_json().encode()
    return {"photo.png": photo, "lines.png": lines, "camera.json": camera}


@pytest.fixture
def folder(tmp_path, monkeypatch, files):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "link.png").symlink_to("photo.png")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def held(folder):
    """All files of a folder, with their contents."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def assert_refused(outcome, exit_code, folder, before, *, as_json=False):
    """Check for one line that says what is wrong, and that no file is written or touched."""
    code, out, err = outcome
    assert (code, out) == (exit_code, ""), err
    assert error_text(err, as_json=as_json)
    assert not re.search(r"\[Errno|Traceback|\.tmp\b", err)
    assert held(folder) == before


def with_argument(arguments, placeholder, value):
    return [argument.replace(placeholder, value) for argument in arguments]


def module_of(name):
    return importlib.import_module(f"{commands.__name__}.{name}")


# Definitions of commands.


def test_the_tables_name_all_commands():
    names = [module.name for module in pkgutil.iter_modules(commands.__path__)]
    found = {name for name in names if hasattr(module_of(name), f"{name}_command")}
    assert found == set(SUMMARIES) == set(WORKING)


@pytest.mark.parametrize("name", SUMMARIES)
def test_help_shows_examples_and_exit_codes(run, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "120")
    code, out, err = run(name, "--help")
    assert (code, err) == (0, "")
    assert run(name, "-h") == (code, out, err)
    assert "\x1b" not in out
    examples = load_command(name).examples
    assert len(examples) >= 2
    for line in (*examples, *EXIT_CODES_HELP.splitlines()):
        assert re.search(rf"^ *{re.escape(line)}$", out, re.MULTILINE)
    for parameter in load_command(name).params:
        assert max(parameter.opts, key=len) in out or parameter.metavar in out


@pytest.mark.parametrize("name", SUMMARIES)
def test_the_description_is_the_command_s_own(run, monkeypatch, name):
    function = getattr(module_of(name), f"{name}_command")
    assert inspect.getdoc(function).split("\n\n")[0].replace("\n", " ") == SUMMARIES[name]
    shown = " ".join(run("--help")[1].replace("│", " ").split())
    assert f"{name} {SUMMARIES[name]}" in shown
    monkeypatch.setenv("COLUMNS", "400")
    lines = [line.strip() for line in run(name, "--help")[1].splitlines()]
    for paragraph in inspect.getdoc(function).split("\n\n"):
        assert " ".join(paragraph.split()) in lines


@pytest.mark.parametrize("name", ["calibrate", "batch"])
def test_help_prints_extras_whole(run, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "300")
    extra = "'trisquare[report]'" if name == "calibrate" else "'trisquare[dask]'"
    assert extra in run(name, "--help")[1]
    assert extra in " ".join(str(each.help) for each in load_command(name).params)


@pytest.mark.parametrize("arguments", WRITTEN, ids=" ".join)
def test_what_is_written_is_said(run, folder, arguments):
    code, out, _ = run(*with_argument(arguments, "OUT", "out"))
    assert len(re.findall(r"^wrote out\.", out, re.MULTILINE)) == 1
    assert (code, (folder / arguments[-1].replace("OUT", "out")).exists()) == (0, True)


@pytest.mark.parametrize("name", SUMMARIES)
def test_the_examples_can_be_parsed(name):
    command = load_command(name)
    for example in command.examples:
        program, called, *arguments = shlex.split(example)
        assert (program, called) == ("trisquare", name)
        command.make_context(name, arguments)


@pytest.mark.parametrize("name", SUMMARIES)
def test_options_are_named_alike(name):
    options = {parameter.name: parameter for parameter in load_command(name).params}
    assert options["json"].opts == ["--json"]
    assert options["quiet"].opts == ["--quiet", "-q"]
    if "output" in options:
        assert options["output"].opts == ["--output", "-o"]
    for parameter in options.values():
        assert parameter.help
        assert parameter.help.endswith((".", ")"))
        # The name of a Python type means nothing to a user.
        assert parameter.metavar or getattr(parameter, "is_flag", False)


# Output of commands.


def documented_keys(stated):
    """The keys of a format that docs/formats.md lists in its table's first column."""
    text = FORMATS_PAGE.read_text("utf-8")
    heading = "## A calibration" if stated == "trisquare/1" else f"**`{stated}`**"
    assert heading in text, stated
    table = text.partition(heading)[2].partition("| --- | --- |\n")[2].partition("\n\n")[0]
    return {key for row in table.splitlines() for key in re.findall("`(\\w+)`", row.split("|")[1])}


@pytest.mark.parametrize("name", SUMMARIES)
def test_json_stands_alone_and_quiet_is_silent(run, folder, name):
    code, out, err = run(name, *WORKING[name], "--json")
    assert (code, err) == (0, "")
    members = json.loads(out)
    assert re.fullmatch(r"trisquare[a-z-]*/\d+", members["format"])
    assert set(members) - {"format"} <= documented_keys(members["format"])
    written = set(held(folder))
    assert run(name, *WORKING[name], "-q") == (0, "", "")
    assert set(held(folder)) == written


@pytest.mark.parametrize("name", SUMMARIES)
def test_json_and_quiet_exclude_each_other(run, folder, name):
    before = held(folder)
    assert_refused(run(name, *WORKING[name], "--json", "--quiet"), 2, folder, before, as_json=True)


@pytest.mark.parametrize("name", SUMMARIES)
def test_the_option_that_was_meant_is_suggested(run, folder, name):
    before = held(folder)
    outcome = run(name, *WORKING[name], "--jsno")
    assert_refused(outcome, 2, folder, before)
    assert f"Did you mean --json? (see trisquare {name} --help)" in outcome[2]


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("calbrate",), "calibrate"),
        (("calibrate", "photo.png", "--model", "radail1"), "radial1"),
        (("calibrate", "photo.png", "--model", "pinhole"), "none"),
        (("calibrate", "photo.png", "--method", "liner"), "linear"),
        (("calibrate", "photo.png", "--fix", "principal-point"), "principal_point"),
        (("calibrate", "photo.png", "--tone", "sgrb"), "srgb"),
        (("calibrate", "photo.png", "--targets", "Squares"), "squares"),
        (("predict", "--size", "640x480", "--model", "Brown"), "brown"),
        (("measure", *TAKEN, FIRST, SECOND, "--targets", "tag"), "tags"),
        (("undistort", *TAKEN, "-o", "out.png", "--interpolation", "cubik"), "cubic"),
        (("convert", "camera.json", "out.yaml", "--to", "opencv4"), "opencv"),
        (("convert", "camera.json", "out.yaml", "--from", "colmpa"), "colmap"),
        (("target", "--page", "Leter"), "Letter"),
        (("target", "--kind", "flats"), "flat"),
    ],
)
def test_the_name_that_was_meant_is_suggested(run, folder, arguments, meant):
    before = held(folder)
    outcome = run(*arguments)
    assert_refused(outcome, 2, folder, before)
    assert f"id you mean {meant!r}?" in outcome[2]


@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (("calibrate", "photo.png", "--square-size", "5mm"), "Did you mean --side?"),
        (("measure", *TAKEN, "--square-size", "5mm"), "Did you mean --side?"),
        (("measure", *TAKEN, "15.5,", "20"), "as 150,120 with no space, not '15.5,'"),
        (("-o", "a.json", "calibrate", "photo.png"), "options of a command come after its name"),
        (("photo.png",), "it is 'trisquare calibrate photo.png'"),
        (("undistort", "photo.png", "camera.json", "-o", "out.png"), "named by --camera FILE"),
    ],
)
def test_a_habit_from_elsewhere_is_answered_with_advice(run, folder, arguments, advice):
    before = held(folder)
    outcome = run(*arguments)
    assert_refused(outcome, 2, folder, before)
    assert advice in outcome[2]


def test_a_word_that_is_no_photograph_may_be_part_of_an_option(run, folder):
    before = held(folder)
    outcome = run("calibrate", "--side", "84", "mm", "photo.png")
    assert_refused(outcome, 5, folder, before)
    assert "a value contains no space (--side 84mm)" in outcome[2]


def test_an_option_that_a_command_does_not_have_is_not_suggested(run):
    assert "--side" not in run("demo", "--square-size", "5mm")[2]


def test_an_unreadable_one_of_several_photographs_is_told_how_to_leave_out(run, folder):
    (folder / "other.png").write_bytes(b"no picture")
    outcome = run("calibrate", "photo.png", "other.png")
    assert outcome[0] == 5
    assert outcome[2].startswith(
        "trisquare: error: other.png: not a readable picture; to calibrate"
    )
    assert "without it" not in run("calibrate", "other.png")[2]


@pytest.mark.parametrize("name", ELSEWHERE)
def test_a_function_s_name_leads_to_its_option(run, folder, name):
    code, out, err = run(name, "photo.png")
    assert (code, out) == (2, "")
    assert f"No such command '{name}': it is 'trisquare {ELSEWHERE[name]}'." in " ".join(
        err.split()
    )
    assert hasattr(ts, name if name != "report" else "write_report")
    command, *_, option = [word for word in ELSEWHERE[name].split() if not word.isupper()]
    options = {own for each in load_command(command).params for own in each.opts}
    assert option in options


def test_what_is_unlike_everything_suggests_nothing(run, folder):
    for arguments in (("zzz",), ("target", "--page", "zzz"), ("target", "--zzz")):
        code, out, err = run(*arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "id you mean" not in err


# Input and output files of commands.


def make_bad(path, kind):
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes({"empty": b"", "text": b"hello\n", "binary": bytes(range(256))}[kind])


BAD = ("missing", "folder", "empty", "text", "binary")


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("arguments", PICTURES_READ, ids=" ".join)
def test_a_bad_picture_exits_5(run, folder, arguments, kind):
    make_bad(folder / "bad.json", kind)
    before = held(folder)
    outcome = run(*with_argument(arguments, "GIVEN", "bad.json"))
    assert_refused(outcome, 5, folder, before)
    assert outcome[2].startswith("trisquare: error: bad.json: ")


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("arguments", FILES_READ, ids=" ".join)
def test_a_bad_file_exits_5_or_2(run, folder, arguments, kind):
    make_bad(folder / "bad.json", kind)
    before = held(folder)
    outcome = run(*with_argument(arguments, "GIVEN", "bad.json"))
    assert_refused(outcome, 5 if kind in ("missing", "folder") else 2, folder, before)
    assert outcome[2].startswith("trisquare: error: bad.json: ")


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs /dev/zero")
@pytest.mark.parametrize("arguments", [*PICTURES_READ, *FILES_READ], ids=" ".join)
def test_an_endless_file_is_not_read_to_its_end(run, folder, arguments):
    (folder / "endless.json").symlink_to("/dev/zero")
    before = held(folder) | {"endless.json": None}
    code, out, err = run(*with_argument(arguments, "GIVEN", "endless.json"))
    assert code in (2, 5)
    assert err.startswith("trisquare: error: endless.json: ")
    assert_refused((code, out, err), code, folder, before)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("arguments", [*PICTURES_READ, *FILES_READ], ids=" ".join)
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(run, folder, arguments):
    # OpenSSL opens certificates by name, including pipes.
    is_serve = arguments[0] == "serve"
    reason = "is no regular file" if is_serve else "is a pipe that no program writes to"
    os.mkfifo(folder / "pipe.json")
    before = held(folder)
    code, out, err = run(*with_argument(arguments, "GIVEN", "pipe.json"))
    assert err.startswith(f"trisquare: error: pipe.json: {reason}")
    assert_refused((code, out, err), 5, folder, before)


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs /dev/fd")
def test_what_is_written_to_a_pipe_is_waited_for(run, folder):
    """Such as ``<(curl ...)`` in a shell."""
    source, sink = os.pipe()
    with ThreadPoolExecutor(1) as threads, open(sink, "wb") as sending:
        sent = threads.submit(send_late, sending, (folder / "photo.png").read_bytes())
        code, _, err = run("calibrate", f"/dev/fd/{source}")
        os.close(source)
        sent.result()
    assert (code, err) == (0, "")


def send_late(pipe, content):
    time.sleep(0.5)
    pipe.write(content)
    pipe.close()


@pytest.mark.parametrize("name", ["calibrate", "measure"])
@pytest.mark.parametrize("size", [(1, 1), IMAGE_SIZE])
def test_a_picture_of_nothing_is_refused(run, folder, name, size):
    width, height = size
    cv2.imwrite("photo.png", np.zeros((height, width), np.uint8))
    before = held(folder)
    exit_code = 2 if name == "measure" and size != IMAGE_SIZE else 3
    assert_refused(run(name, *WORKING[name]), exit_code, folder, before)


@pytest.mark.parametrize("options", [(), ("--rescale",)])
@pytest.mark.parametrize("name", ["measure", "undistort"])
def test_a_picture_of_another_shape_is_no_scaled_one(run, folder, name, options):
    cv2.imwrite("photo.png", PHOTO[:-10])
    before = held(folder)
    outcome = run(name, *WORKING[name], *options)
    assert_refused(outcome, 2, folder, before)
    assert outcome[2].startswith("trisquare: error: photo.png: ")
    assert "another aspect ratio" in outcome[2]


@pytest.mark.parametrize(
    "where",
    [
        "missing/out",
        "photo.png/out",
        "n" * 300,
    ],
    ids=lambda where: where[:12],
)
@pytest.mark.parametrize("arguments", WRITTEN, ids=" ".join)
def test_an_unwritable_output_exits_2(run, folder, arguments, where):
    before = held(folder)
    outcome = run(*with_argument(arguments, "OUT", where))
    assert_refused(outcome, 2, folder, before)
    assert where in outcome[2]


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="needs Linux's /proc")
@pytest.mark.parametrize("arguments", WRITTEN, ids=" ".join)
def test_an_output_that_fails_when_it_is_written_exits_2(run, folder, arguments):
    before = held(folder)
    code, out, err = run(*with_argument(arguments, "OUT", "/proc/out"))
    assert "/proc/out" in error_text(err)
    # A calibration takes long: it is printed nevertheless.
    assert (code, "fx" in out) == (2, arguments[0] == "calibrate")
    assert held(folder) == before


@pytest.mark.parametrize("arguments", WRITTEN, ids=" ".join)
def test_a_folder_is_no_output(run, folder, arguments):
    output = folder / arguments[-1].replace("OUT", "out")
    # Photographs are written into a folder; their own name there cannot be written.
    (output / "photo.png").mkdir(parents=True)
    before = held(folder)
    assert_refused(run(*with_argument(arguments, "OUT", "out")), 2, folder, before)


@pytest.mark.parametrize("arguments", OVERWRITING, ids=" ".join)
def test_no_input_is_overwritten(run, folder, arguments):
    before = held(folder)
    assert_refused(run(*arguments), 2, folder, before)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="needs names of any bytes")
def test_names_need_not_be_text(run, folder):
    """OpenCV crashes on such names."""
    odd = os.fsdecode(b"o\xff")
    for arguments in WRITTEN[1:]:
        code, _, err = run(*with_argument(arguments, "OUT", odd), "-q")
        assert (code, err) == (0, "")
        (folder / arguments[-1].replace("OUT", odd)).rename("out")
    before = held(folder)
    for arguments in (("calibrate", "photo.png", "--overlay"), ("undistort", *TAKEN, "-o")):
        outcome = run(*arguments, f"out.{odd}")
        assert_refused(outcome, 2, folder, before)
        assert "extension" in outcome[2]


def test_folders_to_compare_are_told_of_the_loop(run, folder):
    (folder / "monday").mkdir()
    for arguments in (("monday", "camera.json"), ("camera.json", "monday")):
        code, _, err = run("compare", *arguments)
        assert code == 5
        assert err.startswith("trisquare: error: monday: a folder")
        assert "'Compare two nights'" in err


def test_a_comparison_has_its_grid_in_the_json_only_if_it_is_asked_for(run, folder):
    compare = ("compare", "camera.json", "camera.json")
    grid = {"x", "y", "distance_px", "std_px"}
    for options, expected in ((("--json",), set()), (("--json", "--grid"), grid)):
        code, out, _ = run(*compare, *options)
        assert code == 0
        assert grid & set(json.loads(out)) == expected
    code, _, err = run(*compare, "--grid")
    assert code == 2
    assert "--grid is for --json; --map FILE" in err


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_names_that_cannot_be_encoded_are_escaped(folder, encoding):
    (folder / "pagé.json").write_bytes((folder / "camera.json").read_bytes())
    done = subprocess.run(
        [*COMMAND, "convert", "pagé.json", b"o\xff.yaml"],
        env=plain_environment(PYTHONIOENCODING=encoding),
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    shown = rb"pag\xe9.json" if encoding == "ascii" else "pagé.json".encode()
    assert done.stdout.startswith(shown)
    assert rb"o\udcff.yaml" in done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="needs names with control characters")
@pytest.mark.parametrize(
    "arguments",
    [
        ("calibrate", "NAME", "NAME", "--overlay", "NAMEo.png"),
        ("calibrate", "NAME-gone"),
        ("undistort", "NAME", "--camera", "camera.json", "-o", "NAMEo.png"),
        ("convert", "camera.json", "NAMEo.yaml"),
        ("convert", "NAME", "out.yaml"),
        ("compare", "camera.json", "camera.json", "--map", "NAMEo.png"),
        ("target", "-o", "NAMEo.pdf"),
        ("target", "-o", "t.pdf", "--kind", "NAME"),
        ("calibrate", "photo.png", "--model", "NAME"),
        ("calibrate", "photo.png", "--outline", "NAME"),
        ("calibrate", "photo.png", "--board", "NAME"),
        ("NAME",),
        ("straighten", "lines.png", "-o", "NAMEo.png"),
        ("measure", *TAKEN, "--rectify", "NAMEo.png"),
    ],
    ids=" ".join,
)
def test_control_characters_of_names_do_not_reach_a_terminal(run, folder, files, arguments):
    """They would colour, clear or retitle the terminal, or begin a line with a false message."""
    name = "a\x1b[31m\x1b]0;title\x07\u202e\rb\nwrote all.png"
    (folder / name).write_bytes(files["photo.png"])
    code, out, err = run(*with_argument(arguments, "NAME", name))
    assert code in (0, 2, 5)
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f\u202e]", out + err)
    assert r"a\x1b[31m\x1b]0;title\x07\u202e" in out + err
    assert not any(line.startswith("wrote all") for line in (out + err).split("\n"))


def test_a_negative_coordinate_is_no_option(run, folder):
    before = held(folder)
    outcome = run("measure", *TAKEN, "-5,3", SECOND)
    assert_refused(outcome, 2, folder, before)
    assert "put --" in outcome[2]
    outcome = run("measure", *TAKEN, "--", "-5,3", SECOND)
    assert_refused(outcome, 2, folder, before)
    assert "outside the picture" in outcome[2]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".tif", ".bmp", ".pgm"])
def test_opencv_adds_nothing_to_the_line(folder, files, suffix):
    """In a process of its own, where OpenCV is loaded only after the command."""
    picture = cv2.imencode(suffix, PHOTO)[1].tobytes()
    (folder / f"cut{suffix}").write_bytes(picture[: len(picture) // 2])
    done = subprocess.run(
        [*COMMAND, "calibrate", f"cut{suffix}"], capture_output=True, text=True, check=False
    )
    said = f"trisquare: error: cut{suffix}: not a readable picture\n"
    assert (done.returncode, done.stdout, done.stderr) == (5, "", said)


# Ends of commands.


def fail_with(monkeypatch, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(module_of("target"), "printed_target", fail)


def test_ctrl_c_is_one_line(run, folder, monkeypatch):
    fail_with(monkeypatch, KeyboardInterrupt())
    assert run("target") == (130, "", "trisquare: error: interrupted\n")


@pytest.mark.parametrize("kind", [KeyError, BaseException])
def test_a_fault_of_our_own_is_one_line(run, folder, monkeypatch, kind):
    before = held(folder)
    fail_with(monkeypatch, kind("of ours"))
    outcome = run("target")
    assert_refused(outcome, 70, folder, before)
    assert f"{kind.__name__}: {kind('of ours')}" in outcome[2]
    monkeypatch.setenv("TRISQUARE_TRACEBACK", "1")
    code, _, err = run("target")
    assert code == 70
    assert "Traceback" in err


# In a process of its own.

COLOUR = re.compile(r"\x1b\[[0-9;]*3[0-7]m")


def plain_environment(**more):
    asking = ("NO_COLOR", "FORCE_COLOR", "PY_COLORS", "GITHUB_ACTIONS", "TTY_COMPATIBLE")
    return {name: value for name, value in os.environ.items() if name not in asking} | {
        **more,
        "TERM": "xterm-256color",
    }


@pytest.mark.slow
def test_colours_are_for_terminals_that_want_them():
    arguments = ("target", "--help")
    assert COLOUR.search(on_terminal(arguments, "stdout", plain_environment()))
    quenched = on_terminal(arguments, "stdout", plain_environment(NO_COLOR="1"))
    assert "Examples" in quenched
    assert not COLOUR.search(quenched)
    piped = subprocess.run(
        [*COMMAND, *arguments], env=plain_environment(), capture_output=True, check=True
    )
    assert b"\x1b" not in piped.stdout


@pytest.mark.slow
def test_progress_is_shown_to_whoever_watches(folder):
    arguments = ("calibrate", "photo.png")
    shown = on_terminal(arguments, "stderr", plain_environment())
    assert 0 <= shown.find("measuring") < shown.find("fitting")
    assert on_terminal((*arguments, "-q"), "stderr", plain_environment()) == ""


@pytest.mark.slow
@pytest.mark.parametrize("buffered", [True, False])
@pytest.mark.parametrize("option", ["--json", "--help"])
def test_a_closed_pipe_is_no_error_to_tell(folder, option, buffered):
    environment = plain_environment(PYTHONUNBUFFERED="" if buffered else "1")
    with subprocess.Popen(
        [*COMMAND, "target", option],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (1, b"")


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("buffered", [True, False])
@pytest.mark.parametrize("arguments", [("target", "--json"), ("--version",)])
def test_a_full_disk_behind_standard_output_is_one_line(folder, arguments, buffered):
    environment = plain_environment(PYTHONUNBUFFERED="" if buffered else "1")
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *arguments],
            env=environment,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    said = error_text(done.stderr, as_json="--json" in arguments)
    assert said.rstrip() == "standard output: No space left on device"


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(
    ("handler", "code"), [("default_int_handler", -signal.SIGINT), ("SIG_IGN", 0)]
)
def test_ctrl_c_while_the_command_is_loaded_prints_nothing(handler, code):
    script = (
        "import os, signal, sys\n"
        f"signal.signal(signal.SIGINT, signal.{handler})\n"
        "class Interrupted:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'typer': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupted())\n"
        "from trisquare.__main__ import main\n"
        "main()\n"
    )
    command = [sys.executable, "-c", script, "--version"]
    done = subprocess.run(command, capture_output=True, check=False)
    said = f"trisquare {ts.__version__}\n".encode() if code == 0 else b""
    assert (done.returncode, done.stdout, done.stderr) == (code, said, b"")


def test_help_does_not_wait_for_opencv():
    for argument in ("--help", "--version"):
        script = (
            "import sys\nfrom trisquare.cli import main\n"
            f"try: main([{argument!r}])\n"
            "finally: assert 'cv2' not in sys.modules, 'loaded'"
        )
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
        assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["trisquare", "co"], ["compare", "convert"]),
        (["trisquare", "calibrate", "--ov"], ["--overlay"]),
        (["trisquare", "calibrate", "--model", "radial"], ["radial1", "radial2", "radial3"]),
        (["trisquare", "convert", "--to", "ro"], ["ros"]),
        (["trisquare", "target", "--page", "A"], ["A4", "A3"]),
    ],
)
def test_the_shell_is_offered_names(words, offered):
    environment = plain_environment(
        _TRISQUARE_COMPLETE="complete_bash",
        COMP_WORDS=" ".join(words),
        COMP_CWORD=str(len(words) - 1),
    )
    done = subprocess.run(COMMAND, env=environment, capture_output=True, text=True, check=True)
    assert (done.stdout.split(), done.stderr) == (offered, "")
