"""Jobs on processes that die, hang or exhaust memory, and on other executors."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import pytest
from batches import SIZE, encoded, make_pictures, quick
from scenes import squares

import trisquare as ts
from trisquare import simulate
from trisquare.batch.limits import JobLimits
from trisquare.batch.run import Submission, finished
from trisquare.batch.workers import Workers


def jobs_of(*names):
    return [ts.Job(name, (f"{name}.png",)) for name in names]


def outcomes(jobs, executor=None, workers=2, window=8, **limits):
    bounds = JobLimits.stated(**limits)
    with Submission(executor, None if executor else workers, bounds, quick) as submit:
        return {own.job.name: own.record for own in finished(jobs, submit, None, window)}


def code_of(record):
    return record["error"]["code"] if record["status"] == "failed" else "done"


def test_a_process_that_dies_takes_its_own_job_only():
    names = ["a", "die-1", "b", "die-2", *(f"c{number}" for number in range(20))]
    found = outcomes(jobs_of(*names))
    assert sorted(found) == sorted(names)
    for name, record in found.items():
        assert code_of(record) == ("WorkerDiedError" if name.startswith("die") else "done")
    assert found["die-1"]["error"]["text"] == (
        "probably the system is out of memory, its process died 2 times (SIGKILL): run fewer jobs "
        "at a time, or lower max_pixels (500000000)"
    )


def test_of_a_process_that_ends_itself_both_causes_are_said():
    """The core ends its process without memory, as does a decoder that crashes."""
    found = outcomes(jobs_of("abort-1", "a"), max_memory=2e9)
    assert code_of(found["a"]) == "done"
    assert code_of(found["abort-1"]) == "MemoryError"
    assert found["abort-1"]["error"]["text"] == (
        "its process ended itself 2 times (SIGABRT): compiled code does so if it gets no memory, "
        "and so does a decoder that crashes on a damaged file. Raise max_memory (2 GB), or lower "
        "max_pixels (500000000)"
    )


def test_a_process_that_ends_otherwise_is_not_said_to_lack_memory():
    found = outcomes(jobs_of("exit-1"))
    assert found["exit-1"]["error"]["text"] == "its process died 2 times (exit code 3)"


def test_every_job_is_logged_once(tmp_path, caplog):
    make_pictures(tmp_path, ["a.png"])
    jobs = [ts.Job(name, (tmp_path / f"{name}.png",)) for name in ("a", "gone")]
    with caplog.at_level("INFO", logger="trisquare"):
        found = {own.job.name: own.record for own in ts.calibrate_many(jobs, workers=1)}
    assert "file" not in found["a"]  # there is none without a folder
    told = sorted((record.levelname, record.getMessage()) for record in caplog.records)
    text = found["gone"]["error"]["text"]
    assert told == [("INFO", "a: done"), ("WARNING", f"gone: MissingImageError: {text}")]


def test_a_name_makes_no_line_of_the_log(tmp_path, caplog):
    with caplog.at_level("INFO", logger="trisquare"):
        list(ts.calibrate_many([ts.Job("b\nINFO: c", (tmp_path / "b\nc.png",))], workers=1))
    (told,) = (record.getMessage() for record in caplog.records)
    assert told.startswith("b\\nINFO: c: MissingImageError: ")
    assert "\n" not in told


def test_a_job_whose_process_died_has_a_second_chance(tmp_path):
    found = outcomes([ts.Job("once", (str(tmp_path / "tried"),))])
    assert code_of(found["once"]) == "done"
    assert (tmp_path / "tried").exists()


def test_processes_that_died_while_idle_are_replaced():
    workers = Workers(JobLimits.stated(), quick)
    try:
        with ThreadPoolExecutor(2) as pool:
            busy = list(pool.map(lambda job: workers.do(job, "."), jobs_of("a", "b")))
        assert [code_of(record) for record, _ in busy] == ["done", "done"]
        idle = [own._process for own in workers._idle]
        for process in idle:
            process.kill()
            process.wait()
        record, _ = workers.do(jobs_of("c")[0], ".")
        assert code_of(record) == "done"
        assert not {own._process for own in workers._all} & set(idle)
    finally:
        workers.close()
    assert len(idle) == 2


def test_a_job_that_cannot_be_pickled_takes_no_process():
    workers = Workers(JobLimits.stated(), quick)
    try:
        for _ in range(2):
            with pytest.raises((AttributeError, pickle.PicklingError)):
                workers.do(ts.Job("one", ("one.png",), {"tone": lambda: 0}), "")
        assert not workers._all
    finally:
        workers.close()


def test_the_second_attempt_is_in_a_new_process(tmp_path):
    workers = Workers(JobLimits.stated(), quick)
    try:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda job: workers.do(job, "."), jobs_of("a", "b")))
        before = set(workers._all)
        record, _ = workers.do(ts.Job("once", (str(tmp_path / "tried"),)), ".")
        assert code_of(record) == "done"
        assert len(before - workers._all) == len(workers._all - before) == 1
    finally:
        workers.close()


def test_a_job_that_takes_too_long_is_given_up():
    start = time.monotonic()
    found = outcomes(jobs_of("hang-1", "a", "b"), max_seconds=1.0)
    assert {name: code_of(own) for name, own in found.items()} == {
        "hang-1": "TimeLimitError",
        "a": "done",
        "b": "done",
    }
    assert "max_seconds" in found["hang-1"]["error"]["text"]
    assert time.monotonic() - start < 3600


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux")
def test_a_job_that_eats_memory_is_given_up():
    found = outcomes(jobs_of("eat-1", "a"), max_memory=2e8)
    assert code_of(found["a"]) == "done"
    assert found["eat-1"]["error"]["text"] == "not enough memory (max_memory allows 0.2 GB)"


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux")
@pytest.mark.parametrize("megabytes", [0.001, 5, 20, 120, 200])
def test_too_little_memory_is_always_told_as_such(tmp_path, megabytes):
    """In the decoder, in Python, in the core, or in a thread that cannot start."""
    picture = cv2.resize(cv2.imdecode(np.frombuffer(encoded(0), np.uint8), 1), None, fx=9, fy=9)
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    limits = {"max_memory": 1e6 * megabytes, "workers": 1}
    (own,) = ts.calibrate_many([ts.Job("a", (tmp_path / "a.png",))], **limits)
    assert code_of(own.record) == "MemoryError"
    assert "max_memory" in own.record["error"]["text"]


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux")
def test_what_libraries_reserve_is_no_memory_of_a_job(tmp_path):
    """OpenBLAS takes 32 MB at its first use, and ends the process if it gets none."""
    make_pictures(tmp_path, ["a.png"])
    jobs = [ts.Job("a", (tmp_path / "a.png",), {"targets": "squares"})]
    (own,) = ts.calibrate_many(jobs, max_memory=2.5e7, workers=1)
    assert code_of(own.record) == "done"


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_any_executor_will_do(kind):
    if kind == "threads":
        executor = ThreadPoolExecutor(2)
    else:
        executor = ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    with executor:
        found = outcomes(jobs_of("a", "die-1", "b", "c"), executor)
    assert {name: code_of(own) for name, own in found.items()} == {
        "a": "done",
        "die-1": "WorkerDiedError",
        "b": "done",
        "c": "done",
    }


def test_a_process_ends_with_the_thread_that_it_is_beside(monkeypatch):
    started = []

    class Noted(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    with ThreadPoolExecutor(2) as executor:
        outcomes(jobs_of("a", "b", "c", "d"), executor)
        assert [own.poll() for own in started] == [None] * len(started)
    assert 1 <= len(started) <= 2
    assert all(own.returncode is not None for own in started)


class Broken(ThreadPoolExecutor):
    def submit(self, *_, **__):
        future = super().submit(int)
        future.result()
        return super().submit(broken)


def broken():
    raise BrokenExecutor("gone")


def test_an_executor_that_fails_is_an_error():
    with Broken(1) as executor, pytest.raises(BrokenExecutor):
        outcomes(jobs_of("a"), executor)


def test_no_more_jobs_are_read_than_the_window_holds():
    read = []

    def jobs():
        for number in range(60):
            read.append(number)
            yield ts.Job(f"a{number}", ("a.png",))

    with Submission(None, 2, JobLimits.stated(), quick) as submit:
        for done, _ in enumerate(finished(jobs(), submit, None, 5), 1):
            assert len(read) <= done + 5
    assert len(read) == 60


def test_who_stops_early_leaves_no_process_behind():
    with Submission(None, 2, JobLimits.stated(), quick) as submit:
        results = finished(jobs_of("a", "hang-1", "hang-2", "b"), submit)
        next(results)
        processes = [own._process for own in submit._workers._all]
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt), submit:
            raise KeyboardInterrupt
        results.close()
    assert processes
    assert all(process.poll() is not None for process in processes)
    assert time.monotonic() - start < 300


def test_processes_end_with_the_one_that_started_them():
    script = (
        "import os, sys; sys.path[:0] = {path!r}\n"
        "from batches import quick\n"
        "from trisquare.batch.jobs import Job\n"
        "from trisquare.batch.limits import JobLimits\n"
        "from trisquare.batch.workers import Workers\n"
        "workers = Workers(JobLimits.stated(), quick)\n"
        "workers.do(Job('a', ('a.png',)), '.')\n"
        "print(next(iter(workers._all))._process.pid, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    ).format(path=[path for path in sys.path if path.endswith("helpers")])
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    end = time.monotonic() + 60.0
    while True:
        try:
            os.kill(int(done.stdout), 0)
        except ProcessLookupError:
            break
        account = Path(f"/proc/{int(done.stdout)}/stat")
        if account.exists() and account.read_text().split()[2] == "Z":
            break  # it has ended, but its parent has not waited for it
        assert time.monotonic() < end
        time.sleep(0.05)


def test_processes_compute_in_one_thread():
    with Submission(None, 1, JobLimits.stated(), threads) as submit:
        ((own),) = finished(jobs_of("a"), submit)
    assert own.record["values"] == {"opencv": 1, "openblas": "1", "video": "1"}


def threads(job, limits):
    import cv2

    numbers = {"opencv": cv2.getNumThreads(), "openblas": os.environ["OPENBLAS_NUM_THREADS"]}
    numbers["video"] = os.environ["OPENCV_FFMPEG_THREADS"]
    return {"name": job.name, "status": "done", "values": numbers}, "{}"


def test_cameras_are_calibrated_as_alone(tmp_path):
    make_pictures(tmp_path, ["a.png", "b.png"])
    (tmp_path / "c.png").write_text("hello")
    jobs = [
        ts.Job("a", (str(tmp_path / "a.png"),), {"model": "radial1"}),
        ts.Job("pooled", [tmp_path / "a.png", tmp_path / "a.png"]),
        ts.Job("c", (tmp_path / "c.png",)),
        ts.Job("b", (tmp_path / "b.png",), {"model": "no such"}),
    ]
    found = {own.job.name: own for own in ts.calibrate_many(jobs, workers=2)}
    alone = ts.calibrate(tmp_path / "a.png", model="radial1")
    assert found["a"].json == alone.to_json()
    assert found["a"].calibration.camera.fx == alone.camera.fx
    assert found["a"].record["std"] == dict(alone.std)
    assert [own["code"] for own in found["pooled"].record["warnings"]].count("repeated_picture")
    assert found["c"].record["error"]["code"] == "ImageError"
    assert "c.png" in found["c"].record["error"]["text"]
    assert found["b"].record["error"]["code"] == "ValueError"
    assert "no such" in found["b"].record["error"]["text"]
    assert not found["b"].is_done
    with pytest.raises(ValueError, match="b: ValueError"):
        _ = found["b"].calibration


def test_a_failure_has_what_was_found_and_rejected(tmp_path):
    """The same as `error_members` in this process."""
    picture = simulate.render(squares(3, count=1, image_size=SIZE), np.random.default_rng(3))
    picture[300:, 380:] = 20  # a shape cut by the border
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    with pytest.raises(ts.TrisquareError) as caught:
        ts.calibrate(tmp_path / "a.png")
    (own,) = ts.calibrate_many([ts.Job("a", (tmp_path / "a.png",))], workers=1)
    assert own.record["format"] == "trisquare-batch-record/1"
    assert own.record["error"] == ts.error_members(caught.value)
    assert len(own.record["error"]["found"]) == 1
    assert own.record["error"]["rejected"]


def test_limits_of_size_hold_in_every_format(tmp_path):
    """Including a format whose header only OpenCV reads."""
    for suffix in (".png", ".pfm"):
        cv2.imwrite(str(tmp_path / f"a{suffix}"), np.zeros((48, 64, 3), np.float32))

    def codes(**limits):
        jobs = [ts.Job(own.name, (own,)) for own in sorted(tmp_path.iterdir())]
        found = ts.calibrate_many(jobs, workers=1, **limits)
        return {own.job.name: own.record["error"]["code"] for own in found}

    assert codes() == {"a.pfm": "DetectionError", "a.png": "DetectionError"}
    for limits in ({"max_pixels": 3071}, {"max_bytes": 50}):
        assert codes(**limits) == {"a.pfm": "ImageError", "a.png": "ImageError"}


def test_there_may_be_hardly_any_limits(tmp_path):
    make_pictures(tmp_path, ["a.png"])
    limits = dict.fromkeys(("max_pixels", "max_bytes", "max_seconds", "max_memory"), 10**30)
    (own,) = ts.calibrate_many([ts.Job("a", (tmp_path / "a.png",))], workers=1, **limits)
    assert own.is_done, own.record


def test_a_lens_to_hold_may_be_a_file(tmp_path):
    make_pictures(tmp_path, ["a.png"])
    first = ts.calibrate(tmp_path / "a.png", fix="aspect")
    first.camera.save(tmp_path / "camera.json")
    options = {"initial": str(tmp_path / "camera.json"), "fix": ["distortion"]}
    (own,) = ts.calibrate_many([ts.Job("a", (tmp_path / "a.png",), options)], workers=1)
    assert (own.calibration.camera.distortion == first.camera.distortion).all()
    assert own.calibration.fixed == ("distortion",)


def test_two_jobs_of_one_name(tmp_path):
    make_pictures(tmp_path, ["a.png"])
    picture = (tmp_path / "a.png",)
    jobs = [
        ts.Job("Cam", picture),
        ts.Job("cam", picture, {}, "list.csv:3"),
        ts.Job("Cam", picture),
    ]
    found = list(ts.calibrate_many(jobs, workers=1))
    codes = {own.record["name"]: code_of(own.record) for own in found}
    assert codes == {"Cam": "done", "list.csv:3": "ValueError", "job 3": "ValueError"}
    assert all("an earlier job has the name" in str(own.record) for own in found if not own.is_done)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"workers": 0}, ValueError),
        ({"workers": True}, ValueError),
        ({"window": 0}, ValueError),
        ({"max_seconds": -1.0}, ValueError),
        ({"max_seconds": float("nan")}, ValueError),
        ({"max_pixels": "many"}, TypeError),
        ({"max_pixels": 1.5}, ValueError),
        ({"max_bytes": 1e6 + 0.5}, ValueError),
        ({"workers": 2, "executor": ThreadPoolExecutor(1)}, ValueError),
    ],
)
def test_wrong_arguments_are_refused_before_anything_runs(arguments, error):
    with pytest.raises(error):
        ts.calibrate_many([], **arguments)


def test_what_is_no_job_is_refused():
    with pytest.raises(TypeError, match="Job"):
        list(ts.calibrate_many(["photo.jpg"]))


def test_a_job_that_is_abandoned_ends_at_once_and_the_next_is_done():
    workers = Workers(JobLimits.stated(max_seconds=600.0), quick)
    (hanging, other), answers = jobs_of("hang-1", "a"), []
    thread = threading.Thread(target=lambda: answers.append(workers.do(hanging, ".")))
    try:
        workers.abandon(other)  # which no process has started
        thread.start()
        while thread.is_alive():
            workers.abandon(hanging)
            time.sleep(0.05)
        (record, calibration) = answers[0]
        assert (code_of(record), calibration) == ("AbandonedError", None)
        assert code_of(workers.do(other, ".")[0]) == "done"
    finally:
        workers.close()
        thread.join()


def test_what_is_no_executor_is_refused_by_name():
    with pytest.raises(TypeError, match="executor must have the method submit"):
        ts.calibrate_many([], executor=3)
