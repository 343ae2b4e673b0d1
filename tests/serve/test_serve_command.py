"""`trisquare serve` itself: its address, output and end."""

import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from importlib import resources

import cv2
import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="needs the extra serve")

COMMAND = (sys.executable, "-m", "trisquare", "serve")


@contextmanager
def served(*options, errors=None, environment=()):
    """Run the command on a free port, and end it by Ctrl-C; yield its printed address."""
    command = [*COMMAND, "--port", "0", "--json", *options]
    own = {**os.environ, **dict(environment)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=errors, text=True, env=own
    ) as server:
        told = ""
        while not told.endswith("}\n"):
            line = server.stdout.readline()
            assert line, "it has ended"
            told += line
        try:
            answer = json.loads(told)
            assert answer["address"].endswith(f"token={answer['token']}")
            yield answer["address"]
        finally:
            server.send_signal(2)
            try:
                assert server.wait(30) == 0
            finally:
                server.kill()  # otherwise the tests would wait for it


def refused(*options):
    """Return the one line with the reason why it does not serve."""
    done = subprocess.run([*COMMAND, *options], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_it_serves_this_machine_alone_and_only_with_the_token():
    with served() as address:
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=30) as answer:
            assert b"Calibrate a camera" in answer.read()
            assert answer.headers["server"] is None
        with pytest.raises(urllib.error.HTTPError, match="401") as error:
            urllib.request.urlopen(address.split("?")[0], timeout=30)
        error.value.close()


def test_the_address_of_all_networks_is_one_that_can_be_opened():
    with served("--host", "0.0.0.0") as address:
        assert "//0.0.0.0:" not in address
        direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with direct.open(address, timeout=30) as answer:
            assert b"Calibrate a camera" in answer.read()


def test_every_run_has_another_token():
    with served() as first, served() as second:
        tokens = {address.split("token=")[1] for address in (first, second)}
    assert len(tokens) == 2
    assert min(map(len, tokens)) >= 32


def test_the_token_may_be_stated_by_the_environment(monkeypatch, run):
    monkeypatch.setenv("TRISQUARE_TOKEN", "of-the-environment")
    with served() as address:
        assert address.endswith("/?token=of-the-environment")
    with served("--token", "of-the-command-line") as address:
        assert address.endswith("/?token=of-the-command-line")
    monkeypatch.setenv("TRISQUARE_TOKEN", "short")
    code, _, err = run("serve", "--port", "0")
    assert code == 2
    assert "TRISQUARE_TOKEN must have 16 to 200 letters" in err


def test_every_limit_is_set_by_an_option():
    limits = ("--max-bytes", "3M", "--max-pixels", "2M", "--max-seconds", "0.02")
    with served(*limits, "--max-memory", "1G") as address:
        schema = address.replace("/?", "/api/schema?")
        with urllib.request.urlopen(schema, timeout=30) as answer:
            told = json.loads(answer.read())["info"]["description"]
        assert "3000000 bytes" in told
        assert "2000000 pixels" in told
        form = b'--x\r\nContent-Disposition: form-data; name="picture"; filename="a.png"\r\n\r\n'
        picture = (resources.files("trisquare") / "data" / "demo.png").read_bytes()
        find = urllib.request.Request(
            address.replace("/?", "/api/find?"),
            form + picture + b"\r\n--x--\r\n",
            {"Content-Type": "multipart/form-data; boundary=x"},
        )
        with pytest.raises(urllib.error.HTTPError, match="422") as error:
            urllib.request.urlopen(find, timeout=60)
        assert json.loads(error.value.read())["error"]["code"] == "TimeLimitError"
        error.value.close()


@pytest.mark.parametrize("options", [(), ("--verbose",)])
def test_requests_are_logged_on_standard_error_where_that_is_asked_for(tmp_path, options):
    log = tmp_path / "log"
    with log.open("w") as errors, served(*options, errors=errors) as address:
        status = address.replace("/?", "/api/status?")
        with urllib.request.urlopen(status, timeout=30) as answer:
            answer.read()
    lines = log.read_text().splitlines()
    assert len(lines) == len(options)
    assert all("GET /api/status: 200, " in line for line in lines)


def test_it_ends_when_nobody_asks():
    command = [*COMMAND, "--port", "0", "--idle", "0.3", "-q"]
    own = {**os.environ, "TRISQUARE_TOKEN": "0123456789abcdef"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=own)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_what_is_being_answered_at_the_end_has_its_grace(tmp_path):
    """A search of some seconds is answered although Ctrl-C comes during the computation."""
    noise = np.random.default_rng(0).integers(0, 256, (400, 500), np.uint8)
    picture = cv2.imencode(".jpg", cv2.resize(noise, (3000, 2400)))[1].tobytes()
    form = b'--x\r\nContent-Disposition: form-data; name="picture"; filename="a.jpg"\r\n\r\n'
    answers = []

    def ask(address):
        find = urllib.request.Request(
            address.replace("/?", "/api/find?"),
            form + picture + b"\r\n--x--\r\n",
            {"Content-Type": "multipart/form-data; boundary=x"},
        )
        with urllib.request.urlopen(find, timeout=60) as answer:
            answers.append(json.loads(answer.read()))

    folder = tmp_path / "folders"
    folder.mkdir()
    with served("--grace", "60", environment={"TMPDIR": str(folder)}) as address:
        asking = threading.Thread(target=ask, args=(address,))
        asking.start()
        while not list(folder.glob("*/*/a.jpg")):  # until it has arrived
            time.sleep(0.01)
    asking.join()
    assert [one["found"] for one in answers] == [[]]


def test_a_taken_port_and_a_foreign_address_are_told():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"cannot listen on 127.0.0.1, port {port}: " in refused("--port", str(port))
    assert "cannot listen on 192.0.2.1" in refused("--host", "192.0.2.1", "--port", "0")


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--port", "65536"), "--port"),
        (("--jobs", "0"), "--jobs"),
        (("--idle", "0"), "--idle"),
        (("--idle", "nan"), "--idle"),
        (("--grace", "-1"), "--grace"),
        (("--token", "short"), "--token"),
        (("--token", "an&ampersand-is-no-letter"), "--token"),
        (("--max-bytes", "many"), "--max-bytes"),
        (("--max-pixels", "-1"), "--max-pixels"),
        (("--max-seconds", "0"), "max_seconds"),
        (("--max-memory", "much"), "--max-memory"),
        (("--key", "key.pem"), "belong together"),
        (("--quiet",), "--quiet does not print the random token"),
    ],
)
def test_wrong_options_are_told(run, options, text):
    code, out, err = run("serve", *options)
    assert (code, out) == (2, "")
    assert text in err


def test_without_the_extra_it_says_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    code, out, err = run("serve")
    assert (code, out) == (2, "")
    assert "pip install 'trisquare[serve]'" in err


@pytest.mark.skipif(shutil.which("openssl") is None, reason="there is no openssl")
def test_it_serves_by_https(tmp_path):
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"),
            *("-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"),
            *("-keyout", key, "-out", certificate),
        ],
        check=True,
        capture_output=True,
    )
    trusted = ssl.create_default_context(cafile=certificate)
    with served("--certificate", certificate, "--key", key) as address:
        assert address.startswith("https://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=30, context=trusted) as answer:
            assert answer.status == 200
