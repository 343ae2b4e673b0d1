"""`trisquare batch`: its files, output and exit codes."""

import json
import os
import signal
import subprocess
import time

import cv2
import pytest
from batches import make_pictures
from terminals import COMMAND, on_terminal
from videos import write_frames

import trisquare as ts


@pytest.fixture
def folder(tmp_path, monkeypatch):
    make_pictures(tmp_path, ["in/a.png", "in/b.png"])
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def batch(run):
    """Run the command with one process, because starting processes takes most of its time."""
    return lambda *arguments: run("batch", *arguments, "--jobs", 1)


def test_a_folder_of_pictures(run, folder):
    code, out, err = run("batch", "in", "-o", "results", "--parquet", "--jobs", 2)
    assert (code, err) == (0, "")
    assert "2 cameras (2 done now): 2 passed" in out
    assert sorted(path.name for path in (folder / "results").iterdir()) == [
        ".lock",
        "cameras",
        "results.jsonl",
        "summary.csv",
        "summary.html",
        "summary.parquet",
    ]
    stored = ts.Calibration.from_json((folder / "results/cameras/a.json").read_text())
    assert stored.camera.fx == ts.calibrate("in/a.png").camera.fx
    code, out, err = run("batch", "in", "-o", "results", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["done_now"] == 0
    assert run("compare", "results/cameras/a.json", "results/cameras/a.json")[0] == 0


def test_options_are_for_all_and_a_manifest_s_own_come_first(batch, folder):
    records = [
        {"name": "own", "photographs": "in/a.png", "model": "brown"},
        {"name": "shared", "photographs": ["in/b.png"]},
    ]
    (folder / "list.jsonl").write_text("".join(json.dumps(own) + "\n" for own in records))
    options = ("--model", "radial1", "--fix", "aspect", "--tone", "2.2")
    assert batch("list.jsonl", "-o", "out", *options)[0] == 0
    found = {
        name: ts.Calibration.from_json((folder / f"out/cameras/{name}.json").read_text())
        for name in ("own", "shared")
    }
    assert [own.camera.model for own in found.values()] == ["brown", "radial1"]
    assert {own.fixed for own in found.values()} == {("aspect",)}
    assert {own.tone for own in found.values()} == {2.2}


def test_a_camera_to_hold_is_for_all(batch, folder):
    ts.calibrate("in/a.png").save("known.json")
    options = ("--initial", "known.json", "--fix", "focal")
    assert batch("in", "-o", "out", *options)[0] == 0
    known = ts.Calibration.load("known.json").camera
    for name in ("a", "b"):
        found = ts.Calibration.load(f"out/cameras/{name}.json")
        assert (found.camera.fx, found.camera.fy) == (known.fx, known.fy)
        assert found.fixed == ("focal",)


def test_videos_are_cameras_among_photographs(batch, folder):
    picture = cv2.imread(str(folder / "in" / "a.png"))
    write_frames(folder / "clip.avi", [picture] * 3)
    inputs = ("clip.avi", "in/b.png", "-o", "out")
    code, out, _ = batch(*inputs)
    assert code == 6
    assert "batch choose frames of it with --frames 10" in " ".join(out.split())
    assert batch(*inputs, "--frames", "2", "--retry")[0] == 0
    clip, photo = (ts.Calibration.load(f"out/cameras/{name}.json") for name in ("clip", "b"))
    assert clip.camera.fx == ts.calibrate("clip.avi", frames=2).camera.fx
    assert photo.camera.fx == ts.calibrate("in/b.png").camera.fx
    assert batch(*inputs, "--frames", "0")[0] == 2


@pytest.mark.parametrize(("cell", "status"), [("2", "done"), ("-1", "failed"), ("two", "failed")])
def test_a_manifest_has_the_frames_of_a_video(batch, folder, cell, status):
    write_frames(folder / "clip.avi", [cv2.imread(str(folder / "in" / "a.png"))] * 2)
    (folder / "list.csv").write_text(f"name,photographs,frames\nleft,clip.avi,{cell}\n")
    batch("list.csv", "-o", "out")
    (record,) = map(json.loads, (folder / "out" / "results.jsonl").read_text().splitlines())
    assert record["status"] == status
    if status == "failed":
        assert "frames must be" in record["error"]["text"]


def test_limits_for_production_decide_the_exit_code(batch, folder):
    (folder / "limits.toml").write_text("[std.fx]\nmost = 1e-9\n")
    code, out, _ = batch("in", "-o", "out", "--limits", "limits.toml")
    assert code == 6
    assert "0 passed, 2 beyond the limits, 0 failed" in out
    answer = json.loads(batch("in", "-o", "out", "--limits", "limits.toml", "--json")[1])
    assert answer["limits"] == ["std.fx <= 1e-09"]
    assert "a: beyond limits: std.fx" in out
    (folder / "limits.toml").write_text("[std.fx]\nmost = 1e9\n")
    assert batch("in", "-o", "out", "--limits", "limits.toml", "-q") == (0, "", "")
    assert "Limits" in (folder / "out/summary.html").read_text()


def test_what_calibrate_many_has_done_is_summed_up_and_held_against_limits(batch, folder):
    options = {"model": "radial1"}
    list(ts.calibrate_many(ts.find_jobs(["in"], options=options), workers=1, output="found"))
    own = [ts.Job("left", ("in/a.png",), options)]
    list(ts.calibrate_many(own, workers=1, output="named"))
    manifest = {"name": "left", "photographs": "in/a.png"}
    (folder / "own.jsonl").write_text(json.dumps(manifest))
    (folder / "limits.toml").write_text("[std.fx]\nmost = 1e-9\n")
    for given, output in (("in", "found"), ("own.jsonl", "named")):
        limits = ("--model", "radial1", "--limits", "limits.toml")
        code, out, _ = batch(given, "-o", output, *limits)
        assert code == 6
        assert "(0 done now): 0 passed" in out
        assert (folder / output / "summary.csv").exists()


def test_those_that_passed_with_a_high_warning_are_told(batch, folder):
    assert batch("in", "-o", "out")[0] == 0
    records = folder / "out/results.jsonl"
    first, second = map(json.loads, records.read_text().splitlines())
    first["warnings"] = [{"code": "glare", "severity": "high", "text": "glare"}]
    records.write_text("".join(json.dumps(own) + "\n" for own in (first, second)))
    code, out, _ = batch("in", "-o", "out")
    assert code == 0
    assert "(0 done now): 2 passed (1 with a warning of high severity), 0 beyond" in out
    answer = json.loads(batch("in", "-o", "out", "--json")[1])
    assert (answer["passed"], answer["passed_with_high_warning"]) == (2, 1)
    (folder / "limits.toml").write_text('[warnings]\nmost = "medium"\n')
    code, out, _ = batch("in", "-o", "out", "--limits", "limits.toml")
    assert code == 6
    assert "1 passed, 1 beyond the limits" in out
    assert "a: beyond limits: warnings: glare is high, above medium" in out


def test_what_fails_is_told_and_the_rest_goes_on(batch, folder):
    (folder / "in" / "bad\x1b[31m.png").write_text("hello")
    (folder / "empty").mkdir()
    code, out, err = batch("in", "empty", "-o", "out")
    assert (code, err) == (6, "")
    assert "4 cameras (4 done now): 2 passed, 0 beyond the limits, 2 failed" in out
    assert "\x1b" not in out
    assert "bad\\x1b[31m: failed" in out
    assert "photographs of 1 to take again (column retake of summary.csv)" in out
    assert "there is no photograph in this folder" in out
    lines = (folder / "out/results.jsonl").read_text().splitlines()
    names = [json.loads(line)["name"] for line in lines]
    assert names == ["a", "b", "bad\x1b[31m", "empty"]


def test_a_camera_that_fails_now_is_said_to_lose_its_file(batch, folder):
    assert batch("in", "-o", "out")[0] == 0
    (folder / "in" / "a.png").write_text("hello")
    for done in (1, 0):  # reported as long as the record has it
        code, out, _ = batch("in", "-o", "out")
        assert code == 6
        assert f"({done} done now)" in out
        assert "; cameras/a.json, of an earlier photograph, is removed" in out
    assert not (folder / "out/cameras/a.json").exists()
    assert (folder / "out/cameras/b.json").exists()


def test_cameras_that_are_no_longer_given_do_not_count(batch, folder):
    """Such as after a camera was retired, or a wrong line of a manifest was corrected."""
    (folder / "in" / "bad.png").write_text("hello")
    assert batch("in", "-o", "out")[0] == 6
    records = (folder / "out/results.jsonl").read_text()
    (folder / "in" / "bad.png").unlink()
    (folder / "in" / "a.png").unlink()
    code, out, err = batch("in", "-o", "out")
    assert (code, err) == (0, "")
    assert "1 camera (0 done now): 1 passed, 0 beyond the limits, 0 failed" in out
    assert "2 more cameras of earlier runs" in out
    assert "bad" not in out
    assert sorted((folder / "out/results.jsonl").read_text().splitlines()) == sorted(
        records.splitlines()
    )
    assert (folder / "out/cameras/a.json").exists()
    table = (folder / "out/summary.csv").read_text()
    assert [line.split(",")[:2] for line in table.splitlines()[1:]] == [
        ["b", "passed"],
        ["a", "earlier"],
        ["bad", "earlier"],
    ]
    page = (folder / "out/summary.html").read_text()
    assert "2 more of earlier runs" in page
    assert "bad" not in page
    answer = json.loads(batch("in", "-o", "out", "--json")[1])
    assert (answer["cameras"], answer["earlier"], answer["all_passed"]) == (1, 2, True)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("missing", "-o", "out"), 5, "missing: there is no such file"),
        (("in", "-o", "out", "--limits", "missing.toml"), 5, "missing.toml"),
        (("in", "-o", "out", "--limits", "wrong.toml"), 2, "wrong.toml: unknown parameter 'f_x'"),
        (("in", "-o", "out", "--model", "brwon"), 2, "did you mean 'brown'"),
        (("in", "-o", "out", "--targets", "sqares"), 2, "squares"),
        (("in", "-o", "out", "--fix", "focal"), 2, "focal"),
        (("in", "-o", "out", "--jobs", "0"), 2, "--jobs"),
        (("in", "-o", "out", "--max-pixels", "many"), 2, "--max-pixels"),
        (("in", "-o", "out", "--max-seconds", "-1"), 2, "max_seconds"),
        (("in", "-o", "out", "--camera", "*.png"), 2, "braces"),
        (("in", "-o", "out", "--camera", "{a}_*.png"), 2, "none of 2 photographs"),
        (
            ("in", "-o", "out", "--jobs", "2", "--dask", "tcp://x:1"),
            2,
            "one of --jobs, --dask and --mpi",
        ),
        (("in", "-o", "in/a.png"), 2, "in/a.png"),
        (("in",), 2, "Missing option"),
    ],
)
def test_wrong_commands_write_nothing(run, folder, arguments, code, message):
    (folder / "wrong.toml").write_text("[f_x]\nmost = 1\n")
    found, out, err = run("batch", *arguments)
    assert (found, out) == (code, "")
    assert message in err
    assert err.count("\n") == 1
    assert not (folder / "out").exists()


def test_names_in_errors_do_not_steer_the_terminal(batch, folder):
    code, _, err = batch("\x1b[31mmissing\x9b", "-o", "out")
    assert code == 5
    assert "\\x1b[31mmissing\\x9b: there is no such file" in err
    assert "\x1b" not in err


def test_a_second_run_is_refused(batch, folder):
    from trisquare.batch.limits import JobLimits
    from trisquare.batch.store import Store

    with Store("out", JobLimits.stated()):
        code, _, err = batch("in", "-o", "out")
    assert code == 2
    assert "out: another run writes to this folder" in err


def test_pictures_may_be_limited(batch, folder):
    most = ("--max-pixels", "0.1M")
    code, out, _ = batch("in/a.png", "-o", "out", *most)
    assert code == 6
    assert "480 x 360 pixels, more than the 100000 that max_pixels allows" in out
    # First nothing has changed, then the limit has.
    assert "(0 done now)" in batch("in/a.png", "-o", "out", *most)[1]
    assert batch("in/a.png", "-o", "out", "--max-pixels", "1M")[0] == 0


def test_failures_are_done_again_when_asked(batch, folder):
    (folder / "in" / "bad.png").write_text("hello")
    assert "(3 done now)" in batch("in", "-o", "out")[1]
    assert "(0 done now)" in batch("in", "-o", "out")[1]
    assert "(1 done now)" in batch("in", "-o", "out", "--retry")[1]


@pytest.mark.slow
def test_ten_thousand_unreadable_files(run, folder):
    (folder / "many").mkdir()
    for number in range(10_000):
        (folder / "many" / f"{number}.jpg").write_bytes(b"\xff\xd8\xffno picture")
    code, out, err = run("batch", "many", "in", "-o", "out")
    assert code == 6
    # No line per file: on a busy machine, progress is printed once a minute.
    assert err.count("\n") <= 5
    assert "10002 cameras (10002 done now): 2 passed, 0 beyond the limits, 10000 failed" in out
    assert out.count("\n") < 20
    assert (folder / "out/summary.html").stat().st_size < 1e6


@pytest.mark.slow
def test_ctrl_c_is_one_line_and_the_next_run_goes_on(folder):
    make_pictures(folder, [f"in/cam{number}.png" for number in range(200)])
    command = [*COMMAND, "batch", "in", "-o", "out", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        journal = folder / "out" / "results.jsonl"
        while not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
            assert process.poll() is None
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, err = process.communicate(timeout=300)
    assert (process.returncode, out, err.count(b"\n")) == (130, b"", 1)
    assert json.loads(err)["error"]["text"] == "interrupted"
    there = journal.read_bytes().count(b"\n")
    answer = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert (answer["cameras"], answer["done_now"]) == (202, 202 - there)


@pytest.mark.slow
def test_progress_is_shown_on_a_terminal(folder):
    environment = {**os.environ, "TERM": "xterm-256color"}
    shown = on_terminal(["batch", "in", "-o", "out"], "stderr", environment)
    assert "2/2" in shown
    assert "/s" in shown


def test_a_log_has_a_line_a_minute(monkeypatch, capsys):
    from trisquare.cli import batch

    clock = [0.0]
    monkeypatch.setattr(batch.time, "monotonic", lambda: clock[0])
    show = batch._log(1000)
    for done in range(1, 201):
        clock[0] += 1.0
        show(done)
    assert capsys.readouterr().err.splitlines() == [
        "60 of 1000 cameras, 1.00/s, 16 min left",
        "120 of 1000 cameras, 1.00/s, 15 min left",
        "180 of 1000 cameras, 1.00/s, 14 min left",
    ]
