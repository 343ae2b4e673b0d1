"""A batch on a Dask cluster of two processes, one of which is killed in the middle."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
import warnings

import pytest
from batches import make_pictures

import trisquare as ts

COMMAND = (sys.executable, "-m", "trisquare", "batch")
PATIENCE = 300.0


@pytest.fixture
def cluster():
    """Start two processes with a thread each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of another project
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=None,
            host="127.0.0.1",
            silence_logs=60,
        ) as cluster:
            yield cluster


def pids(cluster):
    return [nanny.pid for nanny in cluster.workers.values()]


@pytest.mark.slow
def test_a_worker_is_killed_in_the_middle(cluster, tmp_path):
    names = [f"cam{number}.png" for number in range(40)]
    make_pictures(tmp_path / "in", names)
    (tmp_path / "in" / "cam7.png").write_text("no picture")
    results = tmp_path / "out"
    arguments = [*COMMAND, "in", "-o", "out", "--dask", cluster.scheduler_address, "--json"]
    with subprocess.Popen(
        arguments, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        end = time.monotonic() + PATIENCE
        journal = results / "results.jsonl"
        while not (journal.exists() and journal.read_bytes().count(b"\n") >= 5):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < end
            time.sleep(0.01)
        assert journal.read_bytes().count(b"\n") < 40
        os.kill(pids(cluster)[0], signal.SIGKILL)
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 6, err
    answer = json.loads(out)
    assert (answer["cameras"], answer["passed"], answer["failed"]) == (40, 39, 1)
    alone = tmp_path / "alone"
    subprocess.run([*COMMAND, "in", "-o", "alone", "-q"], cwd=tmp_path, check=False)
    for path in sorted(path for path in alone.rglob("*") if path.is_file()):
        assert (results / path.relative_to(alone)).read_bytes() == path.read_bytes(), path


@pytest.mark.slow
def test_a_job_that_kills_its_process_spares_the_worker(cluster, tmp_path):
    """The same from Python, with a client's executor."""
    from distributed import Client

    make_pictures(tmp_path, ["a.png", "b.png"])
    jobs = list(ts.find_jobs([tmp_path / "a.png", tmp_path / "b.png"]))
    before = sorted(pids(cluster))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Client(cluster.scheduler_address) as client:
            found = list(ts.calibrate_many(jobs, client.get_executor(), max_seconds=1e-3))
            again = list(ts.calibrate_many(jobs, client.get_executor()))
    assert {own.record["error"]["code"] for own in found} == {"TimeLimitError"}
    assert all(own.is_done for own in again)
    assert sorted(pids(cluster)) == before


def test_an_address_where_nobody_answers(run, tmp_path, monkeypatch):
    from trisquare.cli import batch

    pytest.importorskip("distributed")
    monkeypatch.setattr(batch, "DASK_SECONDS", 0.2)
    make_pictures(tmp_path, ["a.png"])
    for address in ("tcp://127.0.0.1:9", "nonsense", "quic://x:1"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            code, out, err = run(
                "batch", tmp_path / "a.png", "-o", tmp_path / "out", "--dask", address
            )
        # A dead client that is garbage-collected while another starts can lock both.
        gc.collect()
        assert (code, out) == (2, "")
        assert f"{address}: no Dask scheduler answers there" in err
        assert not (tmp_path / "out").exists()
