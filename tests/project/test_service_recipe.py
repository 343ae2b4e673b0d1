"""The documentation's service, run as printed there."""

import asyncio
import os
import runpy
import threading
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import trisquare as ts

pytest.importorskip("fastapi", reason="FastAPI is not installed (it needs Python 3.11)")
pytest.importorskip("httpx2", reason="httpx2 is not installed (it needs Python 3.11)")
from fastapi.testclient import TestClient

RECIPE = Path(__file__).parents[2] / "docs" / "service.py"
DEMO = (resources.files("trisquare") / "data" / "demo.png").read_bytes()


@pytest.fixture(scope="module")
def service():
    return runpy.run_path(str(RECIPE))


@pytest.fixture(scope="module")
def client(service):
    with TestClient(service["app"]) as client:
        yield client


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    photo = tmp_path_factory.mktemp("photo") / "photo.png"
    photo.write_bytes(DEMO)
    return ts.calibrate(photo, targets="squares")


def encoded(picture, extension=".png"):
    return cv2.imencode(extension, picture)[1].tobytes()


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="there is no affinity")
def test_it_computes_on_the_cores_that_it_may_use(service, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {1, 3, 5})
    monkeypatch.delenv("SERVICE_PROCESSES", raising=False)
    assert runpy.run_path(str(RECIPE))["PROCESSES"] == 3
    monkeypatch.setenv("SERVICE_PROCESSES", "2")
    assert runpy.run_path(str(RECIPE))["PROCESSES"] == 2


def test_a_photograph_becomes_a_calibration(client, alone):
    answer = client.post("/calibrations", content=DEMO)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["x-job"].startswith("tmp")
    assert answer.text == alone.to_json()


def test_callers_at_the_same_time_get_the_same_answer(client, alone):
    begin = threading.Barrier(4)

    def ask(_):
        begin.wait(timeout=60)
        return client.post("/calibrations", content=DEMO).text

    with ThreadPoolExecutor(4) as callers:
        assert set(callers.map(ask, range(4))) == {alone.to_json()}


def test_arguments_reach_the_calibration(client):
    answer = client.post("/calibrations?model=none&tone=linear", content=DEMO)
    found = ts.Calibration.from_json(answer.text)
    assert (found.camera.model, found.tone) == ("none", "linear")
    answer = client.post("/calibrations?tone=2.2", content=DEMO)
    assert ts.Calibration.from_json(answer.text).tone == 2.2


@pytest.mark.parametrize(
    ("query", "content", "status", "error", "said"),
    [
        ("", b"", 415, "ImageError", "empty"),
        ("", b"no picture", 415, "ImageError", "not a readable picture"),
        ("", DEMO[: len(DEMO) // 2], 415, "ImageError", "truncated"),
        ("", encoded(np.full((480, 640), 128, np.uint8)), 422, "DetectionError", "no square"),
        ("", encoded(np.zeros((1, 1), np.uint8)), 422, "DetectionError", "no square"),
        ("?model=fishbowl", DEMO, 400, "ValueError", "fishbowl"),
        ("?tone=bright", DEMO, 400, "ValueError", "bright"),
        ("?modle=auto", DEMO, 400, "ValueError", "unknown: modle; known: model, tone, targets"),
        ("?targets=/etc/secret.JSON", DEMO, 400, "ValueError", "name a board"),
    ],
)
def test_what_is_wrong_is_said(client, query, content, status, error, said):
    answer = client.post(f"/calibrations{query}", content=content)
    assert answer.status_code == status
    found = answer.json()["error"]
    assert found.pop("job", "tmp").startswith("tmp")
    assert found == {"code": error, "text": found["text"], "help": f"faq.html#{error.lower()}"}
    assert said in found["text"]
    assert "/tmp" not in found["text"]


def test_a_refusal_has_what_was_found(client, alone):
    photo = cv2.imdecode(np.frombuffer(DEMO, np.uint8), cv2.IMREAD_GRAYSCALE)
    x, y, width, height = cv2.boundingRect(np.float32(alone.planes[0].corners))
    one = photo[y - 20 : y + height + 20, x - 20 : x + width + 20]
    answer = client.post("/calibrations", content=encoded(one))
    error = answer.json()["error"]
    assert (answer.status_code, error["code"]) == (422, "NotEnoughPlanesError")
    assert {"kind", "image", "corners"} <= error["found"][0].keys()
    assert error["help"] == "faq.html#notenoughplaneserror"


def test_a_form_is_not_the_photograph_s_file(client):
    answer = client.post("/calibrations", files={"file": DEMO})
    assert answer.status_code == 415
    assert "as the body" in answer.json()["error"]["text"]


def test_a_fault_of_the_service_is_an_error_like_the_others():
    def full(*args):
        raise OSError("no space left on device")

    service = runpy.run_path(str(RECIPE))
    service["calibrations"].__globals__["_calibrated"] = full
    with TestClient(service["app"], raise_server_exceptions=False) as client:
        answer = client.post("/calibrations", content=DEMO)
    assert answer.status_code == 500
    assert answer.json()["error"]["code"] == "InternalError"


def test_a_photograph_that_is_too_large_is_not_even_received(client, service):
    answer = client.post("/calibrations", content=bytes(service["MAX_BYTES"] + 1))
    assert (answer.status_code, answer.json()["error"]["code"]) == (413, "TooLargeError")


@pytest.mark.parametrize(
    ("limit", "value", "codes", "statuses"),
    [
        ("max_pixels", 1_000_000, {"ImageError"}, {415}),
        ("max_seconds", 0.001, {"TimeLimitError"}, {422}),
        # Where an allocation in C fails, the process may die before it can report it.
        ("max_memory", 1.0, {"MemoryError"}, {422}),
    ],
)
def test_every_calibration_is_within_limits(client, service, limit, value, codes, statuses):
    usual = service["LIMITS"][limit]
    service["LIMITS"][limit] = value
    try:
        answer = client.post("/calibrations", content=DEMO)
    finally:
        service["LIMITS"][limit] = usual
    code = answer.json()["error"]["code"]
    assert (code in codes, answer.status_code) == (True, ts.http_status(code))
    assert answer.status_code in statuses
    assert client.post("/calibrations", content=DEMO).status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [("GET", "/nothing", 404, "NotFoundError"), ("GET", "/calibrations", 405, "MethodError")],
)
def test_an_unknown_address_or_method_is_told_likewise(client, method, path, status, code):
    answer = client.request(method, path)
    assert (answer.status_code, answer.json()["error"]["code"]) == (status, code)


def test_its_health_is_told(client):
    assert client.get("/health").json() == {"version": ts.__version__, "accepted": 0}


@pytest.mark.parametrize("leaves", [True, False])
def test_a_client_that_leaves_before_its_turn_is_not_computed_for(leaves):
    service = runpy.run_path(str(RECIPE))
    computed, sent = [], []
    done = SimpleNamespace(json="{}", record={"name": "a"})
    service["calibrations"].__globals__["_calibrated"] = lambda *of: computed.append(of) or done
    app = service["app"]
    scope = {"type": "http", "method": "POST", "path": "/calibrations", "headers": []}
    scope["query_string"] = b""
    messages = [{"type": "http.request", "body": DEMO}]

    async def receive():
        if not messages:
            await asyncio.Event().wait()  # the client waits as well
        return messages.pop(0)

    async def send(message):
        sent.append(message)

    async def answered():
        async with app.router.lifespan_context(app):
            for _ in range(service["PROCESSES"]):  # all turns are in use
                await app.state.turns.acquire()
            asking = asyncio.create_task(app(scope, receive, send))
            while messages:
                await asyncio.sleep(0)
            if leaves:
                messages.append({"type": "http.disconnect"})
            app.state.turns.release()
            await asking
            return app.state.accepted

    assert asyncio.run(answered()) == 0
    assert (sent[0]["status"], len(computed)) == ((499, 0) if leaves else (200, 1))


def test_a_full_service_says_when_to_come_again(client, service):
    state = service["app"].state
    state.accepted = service["MAX_WAITING"]
    try:
        answer = client.post("/calibrations", content=DEMO)
    finally:
        state.accepted = 0
    assert (answer.status_code, answer.json()["error"]["code"]) == (503, "BusyError")
    assert int(answer.headers["retry-after"]) > 0
    assert client.post("/calibrations", content=DEMO).status_code == 200
