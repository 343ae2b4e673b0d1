"""Several photographs in several threads: the results and errors are those of one thread."""

import threading
import weakref
from functools import partial
from itertools import permutations

import cv2
import numpy as np
import pytest
from scenes import squares

import trisquare as ts
from trisquare import simulate
from trisquare._support.threads import ahead, in_order, thread_count
from trisquare.images import photographs

FIRST = squares(61, image_size=(640, 480))
PICTURES = [
    simulate.render(scene, np.random.default_rng(seed), noise=2.0, tone="srgb")
    for seed, scene in enumerate(
        (FIRST, *(squares(seed, camera=FIRST.camera) for seed in (62, 63)), FIRST)
    )
]
BLANK = np.full_like(PICTURES[0], 128)


@pytest.fixture
def paths(tmp_path):
    """Four photographs, a blank one, one given twice and one of another size."""
    written = []
    pictures = [*PICTURES[:2], BLANK, PICTURES[1], PICTURES[2], PICTURES[0][:-2], PICTURES[3]]
    for index, picture in enumerate(pictures):
        written.append(tmp_path / f"{index}.png")
        cv2.imwrite(str(written[-1]), picture)
    return written


def test_any_number_of_threads_gives_the_same(paths):
    told = {1: [], 2: [], 5: []}
    found = {
        threads: ts.calibrate(
            paths, threads=threads, progress=lambda *done, own=own: own.append(done)
        )
        for threads, own in told.items()
    }
    codes = [warning.code for warning in found[1].warnings]
    assert {"nothing_found", "repeated_picture", "other_size"} <= set(codes)
    assert found[1].stage == "pixels"
    assert {plane.image for plane in found[1].planes} == {0, 1, 4, 6}
    for threads in (2, 5):
        assert found[threads].to_json() == found[1].to_json()
        assert told[threads] == told[1] == [(done, 7) for done in range(1, 8)]
    assert ts.calibrate(paths).to_json() == found[1].to_json()


def test_many_planes_are_fitted_in_threads_to_the_same_bits():
    scenes = (FIRST, *(squares(seed, camera=FIRST.camera) for seed in range(64, 69)))
    pictures = [
        simulate.render(scene, np.random.default_rng(seed), noise=2.0)
        for seed, scene in enumerate(scenes)
    ]
    one, two = (ts.calibrate(pictures, threads=threads) for threads in (1, 2))
    assert len(one.planes) == 18  # from 16 on, the core distributes them over threads
    assert one.stage == "pixels"
    assert one.to_json() == two.to_json()


def test_the_first_error_is_raised(paths):
    for index in (3, 5):
        paths[index].write_bytes(paths[index].read_bytes()[:5000])
    deep = np.full(BLANK.shape, 9, np.uint16)
    for sources, kind, words in (
        (paths, ts.ImageError, r"3\.png: the PNG is truncated"),
        ([paths[0], deep, paths[3]], ValueError, "picture 1 has uint16 pixels"),
        ([paths[0], paths[2], "none.png", None], ts.ImageError, r"none\.png"),
        ([BLANK, None, paths[3]], TypeError, "not NoneType"),
        ([BLANK, BLANK[:, :-1], BLANK[:-1]], ValueError, "picture 1 is 639 x 480"),
        ([BLANK, BLANK + np.uint8(1)], ts.DetectionError, "no square"),
    ):
        messages = []
        for threads in (1, 2, 4):
            with pytest.raises(kind, match=words) as error:
                ts.calibrate(sources, threads=threads)
            messages.append(str(error.value))
        assert len(set(messages)) == 1


@pytest.mark.parametrize("threads", [0, -1, 1.0, True, "2"])
def test_threads_are_a_whole_number(threads):
    with pytest.raises((TypeError, ValueError), match="threads must be"):
        ts.calibrate(PICTURES, threads=threads)


def test_jobs_are_threads(run, paths):
    code, out, _ = run("calibrate", *paths, "--jobs", "2", "--json")
    assert code == 0
    assert out.rstrip() == ts.calibrate(paths, threads=1).to_json().rstrip()
    code, _, err = run("calibrate", paths[0], "--jobs", "0")
    assert (code, err.count("\n")) == (2, 1)


def test_one_picture_takes_one_thread():
    assert thread_count(None, 1) == thread_count(8, 1) == 1
    assert thread_count(3, 100) == 3
    assert thread_count(None, 10**6) >= 1


@pytest.mark.parametrize("threads", [1, 2])
def test_as_many_pictures_are_in_memory_as_threads(paths, monkeypatch, threads):
    alive, most = weakref.WeakSet(), []

    class Pixels(np.ndarray):
        """An array that can be in a weak set: it is compared by identity."""

        __hash__ = object.__hash__

        def __eq__(self, other):
            return self is other

    read = photographs.load_photograph

    def loaded(*source):
        pixels, turn = read(*source)
        own = pixels.copy().view(Pixels)
        alive.add(own)
        most.append(len(alive))
        return own, turn

    monkeypatch.setattr(photographs, "load_photograph", loaded)
    held = []
    ts.calibrate(paths, threads=threads, progress=lambda *_: held.append(len(alive)))
    assert len(most) == len(paths)
    assert max(most) <= threads
    assert held[-1] == 0


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_ends_it_soon(monkeypatch, threads):
    begun = []
    read = photographs.load_photograph
    monkeypatch.setattr(
        photographs, "load_photograph", lambda *own: begun.append(own) or read(*own)
    )

    def interrupt(done, total):
        raise KeyboardInterrupt

    before = threading.active_count()
    shifted = [np.roll(BLANK, shift, axis=1) for shift in range(30)]
    with pytest.raises(KeyboardInterrupt):
        ts.calibrate(shifted, threads=threads, progress=interrupt)
    assert len(begun) < 10
    assert threading.active_count() == before


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_an_error_is_raised_in_the_place_of_its_result(threads):
    def work(number):
        if number == 5:
            raise ValueError("five")
        return number

    results = in_order([partial(work, number) for number in range(9)], threads)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="five"):
        next(results)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_turns_pass_in_order(order):
    turns, passed = photographs.Turns(), []

    def take(number):
        with turns.turn(number):
            passed.append(number)

    threads = [threading.Thread(target=take, args=(number,)) for number in order]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=10)
    assert passed == [0, 1, 2]


def test_items_are_made_ahead_in_their_order():
    begun = threading.Event()

    def items():
        for number in range(20):
            if number == 3:
                begun.set()
            yield number

    found = ahead(items(), 4)
    assert next(found) == 0
    assert begun.wait(10)  # although the item has not been requested
    assert list(found) == list(range(1, 20))
    assert list(ahead([], 3)) == []


def test_an_error_is_raised_in_the_place_of_the_item():
    def items():
        yield 1
        raise ZeroDivisionError

    found = ahead(items(), 3)
    assert next(found) == 1
    with pytest.raises(ZeroDivisionError):
        next(found)


def test_who_closes_early_stops_the_thread():
    made = []
    found = ahead((made.append(number) for number in range(1000)), 2)
    next(found)
    before = threading.active_count()
    found.close()
    assert threading.active_count() == before - 1
    assert len(made) < 10
