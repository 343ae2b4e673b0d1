"""The API: its routes, refusals and statements, and access only with the token."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import zlib
from email import message_from_bytes
from importlib import resources

import cv2
import numpy as np
import pytest

pytest.importorskip("starlette", reason="needs the extra serve")
pytest.importorskip("python_multipart", reason="needs the extra serve")

import anyio
from scenes import squares
from starlette.testclient import TestClient
from videos import moving, write_frames

import trisquare as ts
from trisquare import simulate
from trisquare.batch.limits import JobLimits
from trisquare.errors import help_of
from trisquare.images.frame_choice import choose_frames
from trisquare.serve.app import create_app
from trisquare.serve.request_log import RequestLog

TOKEN = "the-token-of-the-tests"
LIMITS = JobLimits(max_pixels=3_000_000, max_bytes=8_000_000, max_seconds=60.0, max_memory=1e9)
SIZE = (640, 480)
SCENE = squares(11, image_size=SIZE)
PIXELS = simulate.render(SCENE, np.random.default_rng(12))
PHOTO = cv2.imencode(".png", PIXELS)[1].tobytes()


@pytest.fixture(scope="module")
def client():
    app = create_app(TOKEN, LIMITS, processes=2)
    with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
        yield client


def post(client, name, *pictures, options=None, **files):
    parts = [("picture", (f"p{i}.png", content)) for i, content in enumerate(pictures)]
    parts += [(field, (f"{field}.json", content)) for field, content in files.items()]
    data = {} if options is None else {"options": json.dumps(options)}
    return client.post(f"/api/{name}", files=parts, data=data)


def error_of(answer, status):
    assert answer.status_code == status, answer.text
    error = answer.json()["error"]
    assert error["text"]
    assert error["help"] == help_of(error["code"])
    return error


@pytest.fixture(scope="module")
def result(client):
    answer = post(client, "calibrate", PHOTO)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_calibrates_as_the_function_does(result):
    own = ts.calibrate(PIXELS, threads=1)
    read = ts.Calibration.from_json(json.dumps(result["result"]))
    assert read.to_json() == own.to_json()
    assert {one["name"]: one["std"] for one in result["parameters"]} == dict(own.std)
    assert set(result["diagnosis"]) == set(own.parameters)


def test_finds_what_is_there_and_snaps_what_is_drawn(client):
    found = post(client, "find", PHOTO, options={"guide": True}).json()
    assert found["image_size"] == list(SIZE)
    truth = [np.array(one["corners"]) for one in found["found"]]
    assert len(truth) == 3
    assert found["prediction"]["std"]["fx"] > 0
    drawn = {
        "format": "trisquare-outlines/1",
        "squares": [{"corners": (corners + 3.0).tolist()} for corners in truth]
        + [{"corners": [[5, 5], [45, 5], [45, 45], [5, 45]]}],
    }
    snapped = post(client, "find", PHOTO, options={"outlines": drawn}).json()
    for own, other in zip(truth, snapped["found"], strict=True):
        gaps = np.hypot(*(own[:, None] - np.array(other["corners"])).T)
        assert gaps.min(axis=0).max() < 0.5
    assert ["no edge" in one["reason"] for one in snapped["rejected"]] == [True]


def test_predicts_what_the_calibration_then_states(client, result):
    found = post(client, "find", PHOTO).json()
    options = {"image_size": found["image_size"], "outlines": found["found"]}
    answer = client.post("/api/predict", json=options)
    assert answer.status_code == 200, answer.text
    guided = answer.json()
    stated = {one["name"]: one["std"] for one in result["parameters"]}
    for name in ("fx", "cx"):
        assert 0.25 < guided["std"][name] / stated[name] < 4.0
    known = client.post("/api/predict", json={**options, "camera": result["result"]}).json()
    assert known["focal"] == pytest.approx(result["parameters"][0]["value"])
    assert known["std"]["fx"] == pytest.approx(guided["std"]["fx"], rel=0.5)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_squares_are_told(client, count):
    found = post(client, "find", PHOTO).json()
    options = {"image_size": list(SIZE), "outlines": found["found"][:count]}
    guided = client.post("/api/predict", json=options).json()
    assert guided["std"] is None
    assert not guided["is_enough"]
    assert ["three squares", "two more", "one more"][count] in guided["advice"]


@pytest.mark.parametrize(("count", "is_predicted"), [(0, False), (2, False), (3, True)])
def test_a_board_is_not_taken_for_nothing(client, count, is_predicted):
    found = post(client, "find", PHOTO).json()["found"]
    board = {**found[0], "kind": "chessboard"}
    options = {"image_size": list(SIZE), "outlines": [board, *found[:count]]}
    guided = client.post("/api/predict", json=options).json()
    assert (guided["std"] is not None) == is_predicted
    assert guided["advice"].startswith("A chessboard is found. ") != is_predicted


def picture_of(answer):
    assert answer.status_code == 200, answer.text
    return cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)


def test_draws_undistorts_and_reports(client, result):
    text = json.dumps(result["result"])
    calibration = ts.Calibration.from_json(text)
    assert picture_of(post(client, "overlay", PHOTO, result=text)).shape == (480, 640, 3)
    beyond = post(client, "overlay", PHOTO, result=text, options={"index": 3})
    assert "index must be from 0 to 0" in error_of(beyond, 400)["text"]
    straight = picture_of(post(client, "undistort", PHOTO, camera=text))
    np.testing.assert_array_equal(straight, ts.undistort(PIXELS, calibration.camera))
    shown = post(client, "undistort", PHOTO, camera=text, options={"shown": True})
    assert shown.headers["content-type"] == "image/jpeg"
    assert picture_of(post(client, "preview", PHOTO)).shape == PIXELS.shape
    report = post(client, "report", PHOTO, result=text)
    assert report.status_code == 200, report.text
    assert "p0.png" in report.text


def video(tmp_path, frames):
    write_frames(tmp_path / "clip.avi", frames)
    return (tmp_path / "clip.avi").read_bytes()


def frames_of(answer):
    """The names and pictures of a form, read by the standard library."""
    assert answer.status_code == 200, answer.text
    head = f"Content-Type: {answer.headers['content-type']}\r\n\r\n".encode()
    form = message_from_bytes(head + answer.content)
    assert not form.defects
    return {
        part.get_filename(): cv2.imdecode(
            np.frombuffer(part.get_payload(decode=True), np.uint8), cv2.IMREAD_UNCHANGED
        )
        for part in form.get_payload()
    }


def test_chooses_frames_of_a_video(client, tmp_path):
    content = video(tmp_path, moving(8))
    for count in (1, 3):
        own = choose_frames(tmp_path / "clip.avi", count)
        found = frames_of(post(client, "frames", content, options={"frames": count}))
        assert list(found) == [f"frame-{frame.number}.png" for frame in own]
        for frame, pixels in zip(own, found.values(), strict=True):
            np.testing.assert_array_equal(pixels, frame.pixels)
    assert len(frames_of(post(client, "frames", content))) == 8


@pytest.mark.parametrize(
    ("frames", "status"),
    [(0, 400), (101, 400), (True, 400), ("3", 400), (None, 400), (2, 200)],
)
def test_the_number_of_frames_is_checked(client, tmp_path, frames, status):
    answer = post(client, "frames", video(tmp_path, moving(2)), options={"frames": frames})
    assert answer.status_code == status, answer.text


def test_what_is_no_whole_video_has_no_frames(client, tmp_path):
    content = video(tmp_path, moving(8))
    for wrong in (PHOTO, b"", content[:200], content[: len(content) // 2]):
        error = error_of(post(client, "frames", wrong), 415)
        assert error["code"] == "ImageError"
    large = video(tmp_path, [np.zeros((1500, 2100), np.uint8)])
    assert "max_pixels" in error_of(post(client, "frames", large), 415)["text"]
    assert error_of(post(client, "frames", content, content), 400)
    assert error_of(post(client, "frames"), 400)


@pytest.mark.parametrize(
    "name", ["trisquare", "opencv", "ros", "kalibr", "mrcal", "nerfstudio", "colmap"]
)
def test_converts(client, result, tmp_path, name):
    answer = post(
        client,
        f"convert/{name}",
        camera=json.dumps(result["result"]),
        options={
            "approximate": True,
        },
    )
    assert answer.status_code == 200, answer.text
    path = tmp_path / answer.headers["content-disposition"].split('"')[1]
    path.write_bytes(answer.content)
    assert ts.Camera.load(path).image_size == SIZE


def test_a_format_that_cannot_hold_the_lens_says_what_it_would_cost(client, result):
    text = json.dumps(result["result"])
    assert "approximate" in error_of(post(client, "convert/hugin", camera=text), 409)["text"]
    error_of(post(client, "convert/nothing", camera=text), 400)


def test_an_answer_that_is_taken_for_its_result_says_so(result, tmp_path):
    answer = json.dumps(result)
    with pytest.raises(ValueError, match=r'"format" is missing: pass its member "result"$'):
        ts.Calibration.from_json(answer)
    path = tmp_path / "answer.json"
    path.write_text(answer)
    for load in (ts.Calibration.load, ts.Camera.load):
        with pytest.raises(ValueError, match=r'pass its member "result"$'):
            load(path)


def test_compares(client, result):
    text = json.dumps(result["result"])
    answer = post(client, "compare", first=text, second=text).json()
    assert answer["same"] is True
    assert answer["verdict"].startswith("the same")


def test_pictures_are_pooled_and_outlines_belong_to_one_of_them(client):
    outlines = post(client, "find", PHOTO).json()["found"]
    drawn = {
        "format": "trisquare-outlines/1",
        "pictures": [
            {"index": 1, "squares": [{"corners": one["corners"]} for one in outlines]},
        ],
    }
    other = cv2.imencode(".png", PIXELS[::-1, ::-1])[1].tobytes()
    answer = post(client, "calibrate", other, PHOTO, options={"outlines": drawn})
    assert answer.status_code == 200, answer.text
    assert {plane["image"] for plane in answer.json()["result"]["planes"]} == {1}
    both = post(client, "calibrate", other, PHOTO).json()
    assert {plane["image"] for plane in both["result"]["planes"]} == {0, 1}


# Access.


@pytest.mark.parametrize("path", ["/", "/main.js", "/api/status", "/api/schema", "/nothing"])
@pytest.mark.parametrize("token", [None, "", "wrong", TOKEN[:-1], TOKEN + "x", "\u00e4"])
def test_nothing_is_answered_without_the_token(client, path, token):
    bare = TestClient(client.app)
    answer = bare.get(path, params={} if token is None else {"token": token})
    assert error_of(answer, 401)["code"] == "TokenError"
    assert answer.headers["WWW-Authenticate"] == "Token"
    assert error_of(bare.post("/api/find", content=PHOTO), 401)


def test_the_token_may_be_a_parameter_or_a_header(client):
    bare = TestClient(client.app)
    assert bare.get("/", params={"token": TOKEN}).status_code == 200
    assert bare.get("/", headers={"X-Trisquare-Token": TOKEN}).status_code == 200


def test_every_answer_has_the_strict_headers(client):
    bare = TestClient(client.app)
    for answer in (client.get("/"), client.get("/nothing"), bare.get("/")):
        policy = answer.headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_the_page_names_its_files_with_the_token_and_all_are_served(client):
    bare = TestClient(client.app)
    static = resources.files("trisquare.serve") / "static"
    for file in static.iterdir():
        text = bare.get(f"/{file.name}", params={"token": TOKEN}).text
        for line in text.splitlines():
            if '"./' in line:
                name = line.split('"./')[1].split('"')[0]
                assert name.endswith(f"?token={TOKEN}")
                assert bare.get(f"/{name}").status_code == 200


# Behind a proxy.


def test_all_addresses_of_the_page_are_below_its_own():
    for file in (resources.files("trisquare.serve") / "static").iterdir():
        text = file.read_text("utf-8")
        assert not re.search(r"""(?:src|href)=["']/|url\(["']?/|["'`]/api""", text), file.name


def test_a_proxy_that_adds_the_token_keeps_it_out_of_all_addresses(client):
    """The client's requests have the token only in the header."""
    for name in ("", "main.js", "results.js"):
        text = client.get(f"/{name}").text
        assert '"./' in text
        assert TOKEN not in text


def test_the_names_that_a_proxy_passes_on_do_not_matter(client):
    names = {
        "Host": "cameras.example.org",
        "Origin": "https://elsewhere.example.org",
        "X-Forwarded-Host": "proxy.example.org",
        "X-Forwarded-Proto": "https",
    }
    answer = client.get("/api/status", headers=names)
    assert answer.status_code == 200
    assert not [name for name in answer.headers if name.startswith("access-control-")]


def test_a_slash_too_many_is_an_address_that_is_not_there(client):
    """A redirect would lead to the host stated in the request, with the token."""
    for path in ("/api/status/", "/main.js/"):
        answer = client.get(f"{path}?token={TOKEN}", headers={"Host": "elsewhere.example.org"})
        assert not answer.history
        error_of(answer, 404)


@pytest.mark.parametrize(
    "path", ["/../app.py", "/..%2fapp.py", "/%2e%2e/app.py", "/app.py", "/static", "/.hidden.js"]
)
def test_no_other_file_is_served(client, path):
    error_of(client.get(path), 404)


# Contents of requests.


def bomb(side):
    """A PNG of few bytes whose header and rows state that it is square and large."""

    def chunk(kind, content):
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes((side + 1) * 64), 9)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


HOSTILE = {
    "empty": b"",
    "no picture": b"hello " * 100,
    "truncated": PHOTO[: len(PHOTO) // 2],
    "unfolds": bomb(30000),
    "SVG": b'<svg xmlns="http://www.w3.org/2000/svg"><image href="file:///etc/passwd"/></svg>',
    "noise": b"\xff\xd8\xff" + bytes(range(256)) * 40,
}


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("route", ["find", "calibrate", "preview"])
def test_a_hostile_picture_is_an_error_with_a_code_and_a_text(client, route, kind):
    error = error_of(post(client, route, HOSTILE[kind]), 415)
    assert error["code"] == "ImageError"
    assert "p0.png" in error["text"]
    assert "/tmp" not in error["text"]


def test_a_picture_without_squares_is_an_error_that_says_so(client):
    flat = cv2.imencode(".png", np.full((200, 300), 128, np.uint8))[1].tobytes()
    error = error_of(post(client, "calibrate", flat), 422)
    assert error["code"] == "DetectionError"
    assert (error["found"], error["rejected"]) == ([], [])


def test_what_was_found_comes_with_a_refusal(client):
    few = PIXELS.copy()
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    for plane in (0, 1):
        x, y, width, height = cv2.boundingRect(np.float32(SCENE.image_points(plane, corners)))
        few[y - 5 : y + height + 5, x - 5 : x + width + 5] = few[2, 2]
    error = error_of(post(client, "calibrate", cv2.imencode(".png", few)[1].tobytes()), 422)
    assert error["code"] == "NotEnoughPlanesError"
    assert len(error["found"]) == 1


def test_too_many_bytes_are_refused_stated_or_not(client):
    large = bytes(LIMITS.max_bytes + 1)
    assert error_of(post(client, "find", large), 413)["code"] == "TooLargeError"

    def unstated():
        yield b'--x\r\nContent-Disposition: form-data; name="picture"; filename="p.png"\r\n\r\n'
        for _ in range(10):
            yield bytes(LIMITS.max_bytes // 8)

    headers = {"content-type": "multipart/form-data; boundary=x"}
    answer = client.post("/api/find", content=unstated(), headers=headers)
    assert error_of(answer, 413)["code"] == "TooLargeError"


@pytest.mark.parametrize("as_form", [True, False], ids=["form", "body"])
def test_options_of_many_bytes_are_refused_before_they_are_parsed(client, as_form):
    options = b'{"squares": "' + bytes([ord("x")]) * (1 << 20) + b'"}'
    if as_form:
        answer = client.post("/api/predict", files={"options": ("options.json", options)})
    else:
        answer = client.post("/api/predict", content=options)
    assert error_of(answer, 413)["code"] == "TooLargeError"


@pytest.mark.parametrize("depth", [60, 700, 100_000])
def test_options_that_are_nested_deep_are_the_clients_fault(client, depth):
    options = '{"squares": ' + "[" * depth + "]" * depth + "}"
    error = error_of(client.post("/api/predict", content=options), 400)
    assert error["code"] == "ValueError"
    assert error["text"].endswith("the options are nested too deeply")


def test_a_flag_is_true_or_false(client, result):
    camera, options = json.dumps(result["result"]), {"approximate": "false"}
    answer = post(client, "convert/opencv", camera=camera, options=options)
    assert "approximate must be true or false" in error_of(answer, 400)["text"]


@pytest.mark.parametrize("name", ["x" * 300 + ".js", ".hidden.js", "app.py"])
def test_what_is_no_file_of_the_page_is_not_found(client, name):
    assert error_of(client.get(f"/{name}"), 404)["code"] == "NotFoundError"


def answered_after(app, token, headers=(), stated=None):
    """Post a megabyte in pieces; return the status, and the number of pieces received before it."""
    sent, received = [], []
    length = [] if stated is None else [(b"content-length", str(stated).encode())]
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/api/nothing",
        "query_string": f"token={token}".encode(),
        "headers": [*headers, *length],
    }

    async def receive():
        received.append(len(received))
        return {"type": "http.request", "body": bytes(100_000), "more_body": len(received) < 10}

    async def send(message):
        sent.append((message, len(received)))

    anyio.run(app, scope, receive, send)
    message, count = sent[0]
    return message["status"], count


@pytest.mark.parametrize(("token", "status"), [("of-somebody-else", 401), (TOKEN, 404)])
def test_a_refusal_waits_until_the_request_has_arrived(client, token, status):
    """Otherwise a proxy that is still sending would answer with a bad gateway."""
    assert answered_after(client.app, token) == (status, 10)
    # No more than the allowed size is awaited, nor a body that the client holds back until asked.
    assert answered_after(client.app, token, stated=LIMITS.max_bytes + 1)[1] == 0
    assert answered_after(client.app, token, [(b"expect", b"100-continue")]) == (status, 0)


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"--x\r\nnonsense", "multipart/form-data; boundary=x"),
        (b"nothing", "multipart/form-data"),
        (b"{", "application/json"),
        (b"[1]", "application/json"),
        (b"[" * 200_000, "application/json"),
    ],
)
def test_a_damaged_body_is_an_error(client, content, kind):
    for name in ("find", "predict"):
        error_of(client.post(f"/api/{name}", content=content, headers={"content-type": kind}), 400)


@pytest.mark.parametrize(
    ("route", "expected"),
    [
        ("find", "send multipart/form-data with the fields picture, options, not"),
        ("report", "send multipart/form-data with the fields picture, result, options, not"),
        ("predict", "send a JSON object: "),
    ],
)
def test_a_photograph_as_the_body_is_told_what_to_send(client, route, expected):
    kind = {"content-type": "image/png"}
    error = error_of(client.post(f"/api/{route}", content=PHOTO, headers=kind), 400)
    assert error["text"].startswith(expected)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (["photo"], "unknown field 'photo': choose one of picture, result, options"),
        (["picture", "resutl"], "did you mean 'result'? choose one of picture, result, options"),
        (["camera"], "unknown field 'camera'"),
        (["picture", "result", "result"], "the field 'result' is given twice"),
        (["options", "options"], "the field 'options' is given twice"),
    ],
)
def test_a_field_that_a_route_does_not_know_is_refused(client, fields, text):
    files = [(field, ("a", b"{}")) for field in fields]
    assert text in error_of(client.post("/api/overlay", files=files), 400)["text"]


@pytest.mark.parametrize(
    ("route", "options"),
    [
        ("calibrate", {"targets": "/etc/layout.json"}),
        ("calibrate", {"outlines": "/etc/passwd"}),
        ("calibrate", {"initial": "/etc/passwd"}),
        ("calibrate", {"model": "nonsense"}),
        ("calibrate", {"model": ["radial2"]}),
        ("calibrate", {"threads": 1000}),
        ("find", {"outlines": ["/etc/passwd"]}),
        ("find", {"outlines": {"format": "trisquare-outlines/1", "squares": []}}),
        ("find", {"targets": "chessboard:1x1"}),
        ("find", {"targets": 3}),
    ],
)
def test_wrong_options_and_paths_are_refused(client, route, options):
    error_of(post(client, route, PHOTO, options=options), 400)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"image_size": [640, 480]},
        {"image_size": "large", "outlines": []},
        {"image_size": [640, -1], "outlines": []},
        {"image_size": [640, 480], "outlines": 3},
        {"image_size": [640, 480], "outlines": [[1, 2]]},
        {"image_size": [640, 480], "outlines": [{"corners": [[1, 2]]}]},
        {"image_size": [640, 480], "outlines": [{"corners": [[0, 0]] * 4, "sides": 3}]},
        {"image_size": [640, 480], "outlines": [], "camera": "camera.json"},
        {"image_size": [640, 480], "outlines": [], "sigma": "x"},
    ],
)
def test_a_wrong_question_to_predict_is_refused(client, options):
    error_of(client.post("/api/predict", json=options), 400)


def test_names_of_files_are_names_alone(client):
    for name in ("../../x.png", "/etc/x.png", "..\\x.png", "con", "a" * 4000, "\x00.png", ""):
        answer = client.post("/api/find", files=[("picture", (name, HOSTILE["no picture"]))])
        assert answer.status_code in (400, 415)
        assert "etc" not in answer.text
        assert ".." not in answer.text
    answer = client.post("/api/find", files=[("picture", ("50%.png", HOSTILE["no picture"]))])
    assert "50%.png" in answer.json()["error"]["text"]


def test_missing_and_doubled_files_are_told(client, result):
    text = json.dumps(result["result"])
    assert "picture" in error_of(post(client, "find"), 400)["text"]
    assert "one picture" in error_of(post(client, "find", PHOTO, PHOTO), 400)["text"]
    assert '"result"' in error_of(post(client, "overlay", PHOTO), 400)["text"]
    assert '"second"' in error_of(post(client, "compare", first=text), 400)["text"]
    error_of(post(client, "compare", first=text, second="no camera"), 400)
    error_of(post(client, "find", PHOTO, nothing=text), 400)


def test_a_picture_of_another_camera_is_refused(client, result):
    small = cv2.imencode(".png", PIXELS[:400])[1].tobytes()
    for route, field in (("overlay", "result"), ("undistort", "camera"), ("report", "result")):
        files = {field: json.dumps(result["result"])}
        assert "640 x 480" in error_of(post(client, route, small, **files), 400)["text"]


# Parallel requests.


def in_threads(calls):
    answers = [None] * len(calls)

    def make(index):
        answers[index] = calls[index]()

    threads = [threading.Thread(target=make, args=(i,)) for i in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def test_fifty_requests_at_a_time_are_all_answered(client):
    alone = post(client, "find", PHOTO).json()
    answers = in_threads([lambda: post(client, "find", PHOTO)] * 50)
    assert [answer.status_code for answer in answers] == [200] * 50
    assert all(answer.json() == alone for answer in answers)


def test_whoever_finds_no_place_is_told_to_come_again():
    app = create_app(TOKEN, LIMITS, processes=1, most_accepted=2)
    with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
        answers = in_threads([lambda: post(client, "calibrate", PHOTO)] * 12)
        refused = [answer for answer in answers if answer.status_code != 200]
        assert 0 < len(refused) < 12
        for answer in refused:
            assert error_of(answer, 503)["code"] == "BusyError"
            assert int(answer.headers["retry-after"]) > 0
        assert post(client, "calibrate", PHOTO).status_code == 200


def test_a_folder_that_cannot_be_made_takes_no_place(monkeypatch):
    app = create_app(TOKEN, LIMITS, processes=1, most_accepted=1)

    def full(**_):
        raise OSError(28, "No space left on device")

    with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
        with monkeypatch.context() as patch:
            patch.setattr("trisquare.serve.jobs.tempfile.mkdtemp", full)
            answer = post(client, "find", PHOTO)
            assert "No space left" in error_of(answer, answer.status_code)["text"]
            assert answer.status_code >= 500
        assert post(client, "find", PHOTO).status_code == 200


# Clients that leave, and work that takes too long.


def left_during(app, body):
    """Post a calibration and leave while it is computed; return the status of the answer."""
    sent, reading = [], iter([{"type": "http.request", "body": body, "more_body": False}])
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/api/calibrate",
        "query_string": f"token={TOKEN}".encode(),
        "headers": [(b"content-type", b"multipart/form-data; boundary=x")],
    }

    def is_working():
        turns = app.state.jobs._turns
        return turns is not None and turns.borrowed_tokens > 0

    async def receive():
        for message in reading:
            return message
        while not is_working():  # wait until it is computed
            await anyio.sleep(0.005)
        return {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    async def answered():
        await app(scope, receive, send)

    anyio.run(answered)
    return sent[0]["status"]


def test_a_client_that_leaves_ends_its_work_and_gives_its_place_back(tmp_path):
    app = create_app(TOKEN, LIMITS, processes=1, most_accepted=1)
    part = b'--x\r\nContent-Disposition: form-data; name="picture"; filename="p.jpg"\r\n\r\n'
    # Thousands of contours, whose search takes longer than leaving.
    noise = np.random.default_rng(0).integers(0, 256, (1400, 2000), np.uint8)
    noise = cv2.resize(noise[::6, ::6].copy(), (2000, 1400))
    picture = cv2.imencode(".jpg", noise)[1].tobytes()
    try:
        assert left_during(app, part + picture + b"\r\n--x--\r\n") == 499
        with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
            assert post(client, "find", PHOTO).status_code == 200
    finally:
        app.state.jobs.close()


def test_what_takes_too_long_or_too_much_is_ended():
    for limits, codes in (
        (JobLimits(3_000_000, 8_000_000, 0.02, 1e9), {"TimeLimitError"}),
        (JobLimits(3_000_000, 8_000_000, 60.0, 1.0), {"MemoryError"}),
    ):
        app = create_app(TOKEN, limits, processes=1)
        with TestClient(app, headers={"X-Trisquare-Token": TOKEN}) as client:
            answer = post(client, "calibrate", PHOTO)
            code = answer.json()["error"]["code"]
            assert code in codes
            error_of(answer, ts.http_status(code))


def test_nothing_is_kept(client, tmp_path):
    root = client.app.state.jobs.folder
    post(client, "find", PHOTO)
    post(client, "find", b"no picture")
    assert list(root.iterdir()) == []
    app = create_app(TOKEN, LIMITS, processes=1)
    with TestClient(app):
        assert app.state.jobs.folder.exists()
    assert not app.state.jobs.folder.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="folders are not held on Windows")
def test_what_a_killed_server_left_is_removed_by_the_next(client, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    script = (
        "import os; from pathlib import Path; from trisquare.serve.jobs import Jobs\n"
        "from trisquare.serve.limits import REQUEST_LIMITS\n"
        "place = Jobs(REQUEST_LIMITS, 1).accept()\n"
        "Path(place.folder, 'photo.jpg').touch()\n"
        "os.kill(os.getpid(), 9)\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    killed = subprocess.run([sys.executable, "-c", script], env=environment, check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = tmp_path.glob("trisquare-serve-*/*/photo.jpg")
    (tmp_path / "trisquare-serve-file").touch()  # not a folder of a server
    (tmp_path / "other").mkdir()
    first = create_app(TOKEN, LIMITS, processes=1).state.jobs
    assert not left.exists()
    second = create_app(TOKEN, LIMITS, processes=1).state.jobs  # the first is still running
    assert sorted(tmp_path.iterdir()) == sorted(
        [first.folder, second.folder, tmp_path / "other", tmp_path / "trisquare-serve-file"]
    )
    first.close()
    second.close()
    assert sorted(own.name for own in tmp_path.iterdir()) == ["other", "trisquare-serve-file"]


def test_every_request_is_a_line_of_the_log_without_the_token(caplog):
    app = create_app(TOKEN, LIMITS, processes=1)
    with caplog.at_level("INFO", "trisquare"), TestClient(RequestLog(app)) as client:
        client.get("/api/status", params={"token": TOKEN})
        client.get("/api/status")
        client.get("/a%0Ab%1B[31m", params={"token": TOKEN})
        client.post("/api/find", params={"token": TOKEN}, content=b"{")
    lines = [record.getMessage() for record in caplog.records]
    asked = [
        "GET /api/status: 200",
        "GET /api/status: 401 TokenError",
        r"GET /a\nb\x1b[31m: 404 NotFoundError",
    ]
    assert [line.rpartition(",")[0] for line in lines] == [*asked, "POST /api/find: 400 ValueError"]
    assert all(0 <= float(line.rpartition(",")[2].removesuffix(" s")) < 60 for line in lines)
    assert TOKEN not in caplog.text


# The schema.


def check(value, schema, where="answer"):
    """Check a value against the few keywords of JSON Schema that the description uses."""
    kinds = schema.get("type")
    known = {
        "object": dict,
        "array": list,
        "string": str,
        "number": (int, float),
        "integer": int,
        "boolean": bool,
        "null": type(None),
    }
    if kinds is not None:
        names = [kinds] if isinstance(kinds, str) else kinds
        assert any(isinstance(value, known[name]) for name in names), where
    if isinstance(value, dict):
        assert set(schema.get("required", ())) <= set(value), where
        others = schema.get("additionalProperties", {})
        for key, member in value.items():
            own = schema.get("properties", {}).get(key)
            assert own is not None or others is not False, f"{where}.{key}"
            check(member, others if own is None else own, f"{where}.{key}")
    elif isinstance(value, list):
        for member in value:
            check(member, schema.get("items", {}), f"{where}[]")


def posted(client):
    """The schema of the routes with a request body."""
    paths = client.get("/api/schema").json()["paths"]
    return {path: methods["post"] for path, methods in paths.items() if "post" in methods}


def test_the_schema_names_the_routes_that_there_are(client):
    schema = client.get("/api/schema").json()
    routes = {route.path for route in client.app.routes if "POST" in (route.methods or ())}
    assert set(schema["paths"]) == {*routes, "/api/status"}
    assert set(posted(client)) == routes
    for path in routes:
        answer = client.get(path)
        assert (answer.status_code, answer.headers["Allow"]) == (405, "POST")
        assert "405" in posted(client)[path]["responses"]


def test_the_status_is_as_the_schema_says(client):
    responses = client.get("/api/schema").json()["paths"]["/api/status"]["get"]["responses"]
    schema = responses["200"]["content"]["application/json"]["schema"]
    status = client.get("/api/status").json()
    check(status, schema)
    assert set(status) == set(schema["properties"])
    refused = client.get("/api/status", headers={"X-Trisquare-Token": "no"})
    check(refused.json(), responses["401"]["content"]["application/json"]["schema"])
    assert refused.status_code == 401


def test_answers_and_errors_are_as_the_schema_says(client, result):
    operations = posted(client)
    text = json.dumps(result["result"])
    found = post(client, "find", PHOTO, options={"guide": True}).json()
    question = {"image_size": found["image_size"], "outlines": found["found"]}
    answers = {
        "find": found,
        "calibrate": result,
        "predict": client.post("/api/predict", json=question).json(),
        "compare": post(client, "compare", first=text, second=text).json(),
    }
    for name, answer in answers.items():
        responses = operations[f"/api/{name}"]["responses"]
        schema = responses["200"]["content"]["application/json"]["schema"]
        check(answer, schema)
        stated = set(schema["properties"])
        assert set(schema["required"]) <= set(answer) <= stated
    for path, operation in operations.items():
        answer = client.post(path.replace("{format}", "ros"), content=b"{")
        assert answer.status_code == 400
        refusal = operation["responses"]["400"]["content"]["application/json"]["schema"]
        check(answer.json(), refusal)
    for name in ("overlay", "undistort", "preview", "report", "convert/{format}"):
        field = "result" if name in ("overlay", "report") else "camera"
        files = {} if name == "preview" else {field: text}
        pictures = () if name.startswith("convert") else (PHOTO,)
        answer = post(client, name.replace("{format}", "ros"), *pictures, **files)
        stated = operations[f"/api/{name}"]["responses"]["200"]["content"]
        assert answer.headers["content-type"].split(";")[0] in stated


def test_only_the_options_of_the_schema_are_taken(client):
    for path, operation in posted(client).items():
        (body,) = operation["requestBody"]["content"].values()
        options = body["schema"]["properties"].get("options", body["schema"])
        assert options["additionalProperties"] is False
        name = path.removeprefix("/api/").replace("{format}", "ros")
        error = error_of(client.post(f"/api/{name}", json={"nothing": 1}), 400)
        assert "unknown option 'nothing'" in error["text"]
        for option in options["properties"]:
            answer = client.post(f"/api/{name}", json={option: None})
            assert "unknown option" not in answer.text
