"""Use in a service: threads, repetition, arrays that callers continue to use, and memory."""

import contextlib
import gc
import os
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
import trisquare._core as _core
from trisquare import simulate
from trisquare.measurement.side_spans import SideSpan

THREADS = 8
SMALL = (640, 480)

# One round of parallel calibrations could pass by luck; each is repeated with shifted starts.
ROUNDS = 2

# Maximum growth in bytes while a process warms up: measured below 0.1 MB. One copy of the samples
# kept per calibration would make 2.4 MB of 500.
LARGEST_GROWTH = 1e6
CALIBRATIONS = 500

# Maximum number of calls, of a few milliseconds each, during which another thread must run once.
BUSY_ROUNDS = 50


@cache
def rendered(seed, kind="square", **options):
    rng = np.random.default_rng(seed)
    camera = simulate.random_camera(rng, SMALL)
    if kind == "chessboard":
        scene = simulate.chessboard_scene(rng, camera, inner_corners=(6, 5))
    else:
        scene = squares(seed, camera, kind=kind)
    return simulate.render(scene, rng, noise=1.5, **options)


def one_plane(photo):
    held = ("aspect", "principal_point", "distortion")
    return ts.calibrate(photo, targets="chessboard:6x5", fix=held)


def one_picture(edges):
    return ts.calibrate_edges(edges, IMAGE_SIZE)


# Simultaneous calls of eight callers: every kind of target, pixel and entry point.
EDGES = [
    edges_of(squares(seed, kind=kind), 0.1, seed) for seed, kind in ((76, "square"), (77, "frame"))
]
ASKED = {
    "squares": lambda: (ts.calibrate, rendered(70)),
    "frames": lambda: (ts.calibrate, rendered(71, "frame", tone="srgb")),
    "in colour": lambda: (ts.calibrate, rendered(72, colour=True, shading=0.3)),
    "float32": lambda: (ts.calibrate, rendered(73, "frame", dtype=np.float32)),
    "chessboard": lambda: (one_plane, rendered(74, "chessboard")),
    "two pictures": lambda: (ts.calibrate, [rendered(70), rendered(70)[::-1, ::-1]]),
    "edges of squares": lambda: (one_picture, EDGES[0]),
    "edges of frames": lambda: (one_picture, EDGES[1]),
}


def bits(result):
    """All numbers of a result, exactly."""
    arrays = [result.camera.K, result.camera.distortion, result.covariance]
    for plane in result.planes:
        arrays += [plane.corners, plane.rotation, plane.translation]
    return result.to_json(), *(array.tobytes() for array in arrays)


def in_threads(calls):
    """The results of all calls, each in a thread of its own, all started at the same time."""
    begin = threading.Barrier(len(calls))

    def made(call):
        begin.wait(timeout=60)
        return call()

    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(made, calls))


def test_eight_threads_give_the_bits_of_one():
    assert len(ASKED) == THREADS
    jobs = [asked() for asked in ASKED.values()]
    alone = [bits(call(given)) for call, given in jobs]
    assert len(set(alone)) == THREADS  # all pictures are different
    for first in range(ROUNDS):
        turned = jobs[first:] + jobs[:first]
        found = in_threads([lambda job=job: bits(job[0](job[1])) for job in turned])
        assert found == alone[first:] + alone[:first]


@pytest.mark.parametrize("name", ASKED)
def test_the_same_input_gives_the_same_bits(name):
    call, given = ASKED[name]()
    assert bits(call(given)) == bits(call(given))


def test_threads_may_share_one_array():
    shared = rendered(70).copy()
    found = in_threads([lambda: bits(ts.calibrate(shared))] * THREADS)
    assert set(found) == {bits(ts.calibrate(rendered(70)))}
    np.testing.assert_array_equal(shared, rendered(70))
    shared[:] = 0  # and it is writeable again


def test_threads_may_share_figures():
    found = in_threads([lambda: bits(ts.calibrate_edges(EDGES[0], IMAGE_SIZE))] * THREADS)
    assert set(found) == {bits(ts.calibrate_edges(EDGES[0], IMAGE_SIZE))}


def test_what_a_caller_does_to_his_arrays_afterwards_changes_nothing():
    photo = rendered(70).copy()
    sides = [np.array(points) for points in EDGES[0][0].points]
    result, figures, square = ts.calibrate(photo), ts.detect(photo), ts.PlaneEdges.square(sides)
    picture = _core.Picture(photo)
    spans = [SideSpan(np.array(f.points[0][[0, -1]]), -float(f.polarity)) for f in figures]
    kept = [bits(result), [f.to_json() for f in figures], square.to_json()]
    measured, *_ = _core.localise(picture, spans, "srgb")
    photo[:] = 0
    for side in sides:
        side[:] = np.nan
    assert kept == [bits(result), [f.to_json() for f in figures], square.to_json()]
    for side, again in zip(measured, _core.localise(picture, spans, "srgb")[0], strict=True):
        np.testing.assert_array_equal(side.points, again.points)
        np.testing.assert_array_equal(side.std, again.std)


@pytest.mark.parametrize("name", ["calibrate", "localise", "fit_distortion"])
def test_the_core_lets_other_threads_run(name, monkeypatch):
    """Python never takes the GIL from a thread here: the core has to release it."""
    entry = getattr(_core, name)
    ticks, during = [0], []

    def watched(*arguments, **options):
        before = ticks[0]
        found = entry(*arguments, **options)
        during.append(ticks[0] - before)
        return found

    dense = edges_of(squares(78), 0.1, spacing=0.05)
    curves = [points for figure in dense for points in figure.points]
    calls = {
        "calibrate": lambda: ts.calibrate_edges(dense, IMAGE_SIZE),
        "localise": lambda: ts.calibrate(rendered(70)),
        "fit_distortion": lambda: ts.fit_distortion(curves, IMAGE_SIZE),
    }

    def work():
        # Repeated, because on a busy machine no other thread may run; with the GIL held, none ever
        # does.
        for _ in range(BUSY_ROUNDS):
            calls[name]()
            if max(during) > 0:
                break

    monkeypatch.setattr(_core, name, watched)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    try:
        worker = threading.Thread(target=work)
        worker.start()
        while worker.is_alive():
            ticks[0] += 1
            time.sleep(1e-4)  # releases the GIL
        worker.join()
    finally:
        sys.setswitchinterval(interval)
    assert during
    assert max(during) > 0


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's accounts")
def test_memory_stays_flat():
    edges = edges_of(squares(79), 0.1, spacing=12.0)

    def resident():
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def calibrate(times):
        for _ in range(times):
            ts.calibrate_edges(edges, IMAGE_SIZE)
            with pytest.raises(ts.NotEnoughPlanesError):
                ts.calibrate_edges(edges[:1], IMAGE_SIZE)

    calibrate(CALIBRATIONS // 5)
    before = resident()
    calibrate(CALIBRATIONS)
    assert resident() - before < LARGEST_GROWTH


def test_a_refusal_leaves_nothing_in_memory():
    def refused():
        with contextlib.suppress(ts.NotEnoughPlanesError):
            ts.calibrate_edges(edges_of(squares(79), 0.1, spacing=12.0)[:1], IMAGE_SIZE)

    def kept():
        gc.collect()
        return sum(isinstance(each, ts.NotEnoughPlanesError) for each in gc.get_objects())

    before = kept()
    refused()
    assert kept() == before
