"""A folder of results: complete, resumed, locked, and byte for byte the same."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from batches import make_pictures, quick, record_of

import trisquare as ts
from trisquare.batch.fleet import Fleet
from trisquare.batch.jobs import faulty_job
from trisquare.batch.limits import JobLimits
from trisquare.batch.run import Submission, finished
from trisquare.batch.store import Store
from trisquare.batch.summary import rows

LIMITS = JobLimits.stated()
HELPERS = os.path.join(os.path.dirname(os.path.dirname(__file__)), "helpers")
COMMAND = (sys.executable, "-m", "trisquare", "batch")


def job(name, photograph="a.png", **options):
    return ts.Job(name, (str(photograph),), options)


def failed(own, code="DetectionError"):
    return {
        "name": own.name,
        "status": "failed",
        "photographs": list(own.photographs),
        "software": "0",
        "error": {"code": code, "text": "nothing"},
    }, None


def add(store, own, answer=None):
    key = own.key
    if store.is_done(own, key):
        return False
    store.add(own, key, answer or (record_of(own), "{}\n"))
    return True


def lines(folder):
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def held(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_what_is_there_is_not_done_again(tmp_path):
    with Store(tmp_path, LIMITS) as store:
        assert all(add(store, job(name)) for name in "ba")
        store.finish()
    with Store(tmp_path, LIMITS) as store:
        assert [add(store, job(name)) for name in "bca"] == [False, True, False]
        store.finish()
        assert [own["name"] for own in store.records()] == list("bca")
    assert [own["name"] for own in lines(tmp_path)] == list("bca")
    assert sorted(path.name for path in (tmp_path / "cameras").iterdir()) == [
        "a.json",
        "b.json",
        "c.json",
    ]


def test_what_has_changed_is_done_again(tmp_path):
    photo = tmp_path / "photo.png"
    photo.write_bytes(b"one")
    results = tmp_path / "results"

    def is_redone(own):
        with Store(results, LIMITS) as store:
            return add(store, own)

    assert is_redone(job("a", photo))
    assert not is_redone(job("a", photo))
    assert is_redone(job("a", photo, model="brown"))
    assert not is_redone(job("a", photo, model="brown"))
    photo.write_bytes(b"others")
    assert is_redone(job("a", photo, model="brown"))
    os.utime(photo, ns=(1, 1))
    assert is_redone(job("a", photo, model="brown"))
    layout = tmp_path / "layout.json"
    layout.write_text("{}")
    assert is_redone(job("a", photo, targets=str(layout)))
    layout.write_text("{ }")
    assert is_redone(job("a", photo, targets=str(layout)))
    (results / "cameras" / "a.json").unlink()
    assert is_redone(job("a", photo, targets=str(layout)))
    photo.unlink()
    assert is_redone(job("a", photo, targets=str(layout)))
    assert len({own["key"] for own in lines(results)}) == len(lines(results)) - 1


@pytest.mark.parametrize("limit", ["PIXELS", "BYTES", "SCANS", "FRAMES", "SECONDS", "MEMORY"])
def test_a_limit_of_the_environment_that_is_none_is_told_before_any_job(limit, monkeypatch):
    """Reported for each picture, it would be a permanent failure."""
    monkeypatch.setenv(f"TRISQUARE_MAX_{limit}", "abc")
    with pytest.raises(ValueError, match=f"TRISQUARE_MAX_{limit} must be a positive number"):
        JobLimits.stated()


def test_failures_are_done_again_if_that_is_asked_for_or_limits_differ(tmp_path, monkeypatch):
    slow, blind = job("slow"), job("blind")
    with Store(tmp_path, LIMITS) as store:
        assert add(store, slow, failed(slow, "TimeLimitError"))
        assert add(store, blind, failed(blind))
    more = JobLimits.stated(max_seconds=1e4)
    monkeypatch.setenv("TRISQUARE_MAX_SCANS", "7")
    other_scans = JobLimits.stated()
    for limits, retry, redone in (
        (LIMITS, False, [False, False]),
        (more, False, [True, False]),
        (other_scans, False, [True, False]),
        (LIMITS, True, [True, True]),
    ):
        with Store(tmp_path, limits, retry=retry) as store:
            keys = [own.key for own in (slow, blind)]
            is_done = [
                store.is_done(own, key) for own, key in zip((slow, blind), keys, strict=True)
            ]
            assert is_done == [not again for again in redone]


def test_what_was_no_job_is_forgotten_when_it_is_given_no_more(tmp_path):
    """Such as after a manifest's line was corrected."""
    wrong, retired, kept = faulty_job("m.jsonl:8", "not JSON"), job("retired"), job("kept")
    with Store(tmp_path, LIMITS) as store:
        for own in (wrong, retired, kept):
            add(store, own, failed(own))
        store.finish()
        assert len(store) == 3
    with Store(tmp_path, LIMITS) as store:
        assert store.is_done(kept, kept.key)
        store.finish()
        assert [own["name"] for own in store.records()] == ["kept", "retired"]


def test_a_camera_that_fails_now_leaves_no_old_file(tmp_path):
    with Store(tmp_path, LIMITS) as store:
        add(store, job("a"))
        store.add(job("a"), "other", failed(job("a")))
        store.add(job("b"), "other", failed(job("b")))
        told = [(own["status"], own.get("removed")) for own in store.records()]
        assert told == [("failed", "cameras/a.json"), ("failed", None)]
    assert not (tmp_path / "cameras" / "a.json").exists()


def test_a_run_that_is_killed_as_a_camera_fails_leaves_no_old_file(tmp_path, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    with Store(tmp_path, LIMITS) as store:
        add(store, job("a"))
        monkeypatch.setattr(store, "_append", killed, raising=False)
        with pytest.raises(KeyboardInterrupt):
            store.add(job("a"), "other", failed(job("a")))
    assert not (tmp_path / "cameras" / "a.json").exists()
    with Store(tmp_path, LIMITS) as store:
        assert not store.is_done(job("a"), job("a").key)


@pytest.mark.parametrize("cut", [1, 40])
def test_a_line_that_was_being_written_is_dropped(tmp_path, cut):
    with Store(tmp_path, LIMITS) as store:
        add(store, job("a"))
        add(store, job("b"))
    path = tmp_path / "results.jsonl"
    path.write_bytes(path.read_bytes()[:-cut])
    with Store(tmp_path, LIMITS) as store:
        assert [add(store, job(name)) for name in "ab"] == [False, True]
        store.finish()
    assert [own["name"] for own in lines(tmp_path)] == ["a", "b"]


def test_lines_of_others_are_dropped(tmp_path):
    (tmp_path / "results.jsonl").write_bytes(b'hello\n[1]\n{"name": "a", "status": "done"}\n\xff\n')
    with Store(tmp_path, LIMITS) as store:
        assert len(store) == 0
        assert add(store, job("a"))
        store.finish()
    assert [own["name"] for own in lines(tmp_path)] == ["a"]


def test_a_record_of_another_version_stays_until_its_job_is_done_again(tmp_path):
    other = {**record_of(job("b")), "key": "k", "format": "trisquare-batch-record/2"}
    path = tmp_path / "results.jsonl"
    path.write_text(json.dumps(other) + "\n")
    with Store(tmp_path, LIMITS) as store:
        assert add(store, job("a"))
        store.finish()
        assert [own["name"] for own in store.records()] == ["a"]
    assert [own["name"] for own in lines(tmp_path)] == ["a", "b"]
    assert lines(tmp_path)[1] == other
    with Store(tmp_path, LIMITS) as store:
        assert add(store, job("b"))
        store.finish()
    assert [own["name"] for own in lines(tmp_path)] == ["b", "a"]
    assert lines(tmp_path)[0]["format"] == "trisquare-batch-record/1"


@pytest.mark.parametrize(
    "damage",
    [
        *({name: None} for name in record_of(job("a")) if name not in ("format", "software")),
        *({name: "12"} for name in ("image_size", "values", "std", "rms_px", "planes", "warnings")),
        *({name: float("nan")} for name in ("rms_px", "noise_scale")),
        {"key": 3},
        {"photographs": [1]},
        {"image_size": [640]},
        {"values": {"fx": 1e308}},
        {"values": {"fz": 1.0}},
        {"std": {"fx": -1.0}},
        {"warnings": [{"code": "a"}]},
        {"warnings": [{"code": "a", "text": "b", "severity": "dire"}]},
        {"format": "trisquare-batch-record/2"},
        {"status": "failed"},
        {"status": "failed", "error": {"code": "DetectionError"}, "limits": {}},
        {"status": "failed", "error": {"code": "A", "text": "b"}, "limits": [1]},
    ],
    ids=str,
)
def test_damaged_records_are_dropped_and_done_again(tmp_path, damage):
    """A summary needs every member: a missing one, or one of another type, would stop it."""
    whole = {**record_of(job("a")), "key": job("a").key}
    (tmp_path / "results.jsonl").write_text(
        "".join(json.dumps(own) + "\n" for own in ({**whole, **damage}, {**whole, "name": "b"}))
    )
    with Store(tmp_path, LIMITS) as store:
        assert [own["name"] for own in store.records()] == ["b"]
        assert add(store, job("a"))
        fleet = Fleet.of(store.records())
        assert len(list(rows(store.records(), fleet, []))) == 2


def test_what_a_killed_run_was_writing_is_removed(tmp_path):
    with Store(tmp_path, LIMITS) as store:
        add(store, job("a"))
    half = (tmp_path / ".summary.csv.0123abcd.tmp", tmp_path / "cameras" / ".b.json.0123abcd.tmp")
    for path in half:
        path.write_text("half")
    with Store(tmp_path, LIMITS):
        assert not any(path.exists() for path in half)
    assert (tmp_path / "cameras" / "a.json").exists()


def test_long_records_are_read_whole(tmp_path):
    long = ts.Job("a", tuple(f"{number:05}.png" for number in range(5000)))
    with Store(tmp_path, LIMITS) as store:
        add(store, long)
        add(store, job("b"))
        store.finish()
        assert [len(own["photographs"]) for own in store.records()] == [5000, 1]


def test_a_second_run_on_the_folder_is_refused(tmp_path):
    with (
        Store(tmp_path, LIMITS),
        pytest.raises(OSError, match="another run writes to this folder"),
    ):
        Store(tmp_path, LIMITS)
    with Store(tmp_path, LIMITS):
        pass


FULL = """
import os, resource, signal, sys
from batches import record_of
from trisquare.batch.limits import JobLimits
from trisquare.batch.store import Store
from trisquare import Job
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
with Store(sys.argv[1], JobLimits.stated()) as store:
    a, b = (Job(name, (name,)) for name in "ab")
    store.add(a, "k", (record_of(a), "{}"))
    most = os.path.getsize(f"{sys.argv[1]}/results.jsonl") + 20
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    store.add(b, "k", (record_of(b), "x" * int(sys.argv[2])))
"""


@pytest.mark.parametrize(("size", "named"), [(10, "results.jsonl"), (1000, "b.json")])
def test_a_disk_that_is_full_is_told_and_leaves_no_half_file(tmp_path, size, named):
    """The process's file size limit fails as a full disk does: in the middle of a file."""
    done = subprocess.run(
        [sys.executable, "-c", FULL, tmp_path, str(size)],
        env={**os.environ, "PYTHONPATH": HELPERS},
        capture_output=True,
        text=True,
        check=False,
    )
    assert f"{named}: cannot be written: File too large" in done.stderr
    assert [own["name"] for own in lines(tmp_path)] == ["a"]
    for path in (tmp_path / "cameras").iterdir():
        assert path.name == "a.json" or (path.name == "b.json" and size == 10)
    with Store(tmp_path, LIMITS) as store:
        assert len(store) == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot be written"):
        Store(tmp_path / "file" / "results", LIMITS)


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_to_the_same_bytes(tmp_path):
    """The run is killed repeatedly at different moments, always by kill -9."""
    names = [f"cam{number}.png" for number in range(12)]
    make_pictures(tmp_path / "photos", names)
    (tmp_path / "photos" / "cam5.png").write_text("no picture")
    arguments = (*COMMAND, str(tmp_path / "photos"), "--jobs", "2", "-q", "-o")
    undisturbed = subprocess.run([*arguments, str(tmp_path / "whole")], check=False)
    assert undisturbed.returncode == 6
    broken = tmp_path / "broken"
    killed_after = []
    for target in (1, 3, 6, 9):
        with subprocess.Popen([*arguments, str(broken)]) as process:
            journal = broken / "results.jsonl"
            while process.poll() is None:
                if journal.exists() and journal.read_bytes().count(b"\n") >= target:
                    process.send_signal(signal.SIGKILL)
                    break
                time.sleep(0.001)
        if process.returncode == -signal.SIGKILL:
            killed_after.append(target)
    assert len(killed_after) > 1
    done = {own["name"] for own in lines(broken)}
    assert len(done) >= killed_after[-1]
    again = subprocess.run(
        [*arguments[:-2], "--json", "-o", str(broken)], stdout=subprocess.PIPE, check=False
    )
    assert json.loads(again.stdout)["done_now"] == 12 - len(done)
    assert held(broken) == held(tmp_path / "whole")


def test_results_are_stored_before_they_are_yielded(tmp_path):
    with Store(tmp_path, LIMITS) as store, Submission(None, 2, LIMITS, quick) as submit:
        for own in finished([job(name) for name in "abcd"], submit, store):
            (stored,) = [line for line in lines(tmp_path) if line["name"] == own.job.name]
            assert stored.items() >= own.record.items()
            assert (tmp_path / own.record["file"]).stat().st_size == own.record["bytes"]
            assert (tmp_path / "cameras" / f"{own.job.name}.json").is_file()


def test_calibrate_many_keeps_a_folder(tmp_path):
    make_pictures(tmp_path, ["a.png", "b.png"])
    jobs = list(ts.find_jobs([tmp_path / "a.png", tmp_path / "b.png"]))
    first = list(ts.calibrate_many(jobs[:1], output=tmp_path / "results", workers=1))
    assert [own.job.name for own in first] == ["a"]
    second = list(ts.calibrate_many(jobs, output=tmp_path / "results", workers=1))
    assert [own.job.name for own in second] == ["b"]
    stored = (tmp_path / "results" / "cameras" / "a.json").read_text()
    assert ts.Calibration.from_json(stored).camera.fx == first[0].calibration.camera.fx
    assert [own["name"] for own in lines(tmp_path / "results")] == ["a", "b"]


def test_a_camera_whose_file_was_changed_is_done_again(tmp_path):
    own = job("one")
    with Store(tmp_path, LIMITS) as store:
        assert add(store, own)
    file = tmp_path / "cameras" / own.file_name
    whole = file.read_bytes()
    file.write_text("damaged")
    with Store(tmp_path, LIMITS) as store:
        assert add(store, own)
        assert not add(store, own)
    assert file.read_bytes() == whole
