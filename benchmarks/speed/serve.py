"""`trisquare serve`: rate of the live preview, and time of a picture."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable

import cv2
import numpy as np
from harness.rows import Row
from starlette.testclient import TestClient

from trisquare import simulate
from trisquare.serve.app import create_app
from trisquare.serve.limits import REQUEST_LIMITS

TOKEN = "token-of-the-benchmark"
PREVIEW = (800, 600)
PHOTOGRAPH = (4000, 3000)
SEED = 3
SECONDS = 5.0
PROCESSES = 2
LIVE_TARGET = 4.0  # per second
PARALLEL = 50
PARALLEL_SECONDS = 60.0
PHOTOGRAPH_SECONDS = 5.0


def measure() -> list[Row]:
    """Print the rate of a live preview while predictions are made, and the times of requests."""
    app = create_app(TOKEN, REQUEST_LIMITS, PROCESSES)
    with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
        return _measured(client)


def _measured(client: TestClient) -> list[Row]:
    preview, photograph = _picture(PREVIEW), _picture(PHOTOGRAPH)

    def find(picture: bytes) -> dict[str, object]:
        answer = client.post(
            "/api/find",
            files=[("picture", ("p.jpg", picture))],
            data={"options": json.dumps({"targets": "squares"})},
        )
        assert answer.status_code == 200, answer.text
        members: dict[str, object] = answer.json()
        return members

    found = find(preview)
    question = {"image_size": found["image_size"], "outlines": found["found"]}

    def predict() -> None:
        assert client.post("/api/predict", json=question).json()["std"]

    predict()  # so that its process has started
    predictions: list[int] = []
    thread = threading.Thread(target=lambda: predictions.append(_repeated(predict)))
    thread.start()
    finds = _repeated(lambda: find(preview))
    thread.join()

    start = time.perf_counter()
    threads = [threading.Thread(target=find, args=(preview,)) for _ in range(PARALLEL)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    parallel = time.perf_counter() - start

    start = time.perf_counter()
    answer = client.post("/api/calibrate", files=[("picture", ("p.jpg", photograph))])
    assert answer.status_code == 200, answer.text
    calibrated = time.perf_counter() - start
    rates = {"searches": finds / SECONDS, "predictions": predictions[0] / SECONDS}
    return [
        *(
            Row(
                f"live preview of {PREVIEW[0]} x {PREVIEW[1]}: {name}",
                f"{rate:.1f} per s",
                f">= {LIVE_TARGET:g}",
                rate >= LIVE_TARGET,
            )
            for name, rate in rates.items()
        ),
        Row(
            f"{PARALLEL} searches at the same time: time until all are answered",
            f"{parallel:.1f} s",
            f"<= {PARALLEL_SECONDS:g}",
            parallel <= PARALLEL_SECONDS,
        ),
        Row(
            "picture of 12 megapixels: time from upload to result",
            f"{calibrated:.2f} s",
            f"<= {PHOTOGRAPH_SECONDS:g}",
            calibrated <= PHOTOGRAPH_SECONDS,
        ),
    ]


def _picture(size: tuple[int, int]) -> bytes:
    rng = np.random.default_rng(SEED)
    camera = simulate.random_camera(rng, size)
    picture = simulate.render(simulate.random_scene(rng, camera=camera), rng, noise=2.0)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def _repeated(act: Callable[[], object]) -> int:
    """Call a function repeatedly for `SECONDS` seconds, and return the number of calls."""
    end, times = time.perf_counter() + SECONDS, 0
    while time.perf_counter() < end:
        act()
        times += 1
    return times
