"""`trisquare serve`: a page that calibrates, in a browser."""

from __future__ import annotations

import logging
import os
import re
import secrets
import stat
import sys
import webbrowser
from pathlib import Path

from trisquare._support.threads import usable_cores
from trisquare.cli.console import answer
from trisquare.cli.framework import reading
from trisquare.cli.options import JSON, QUIET, amount, flag, option
from trisquare.serve import check_extra

SERVICE_FORMAT = "trisquare-service/1"

PORT = 8765
GRACE = 8
"""Seconds to finish requests at the end; `docker stop` kills after ten."""

LARGEST_PORT = 65535
TOKEN_BYTES = 24
TOKEN = re.compile(r"[A-Za-z0-9_-]{16,200}")
"""Tokens that are valid in an address and long enough not to be guessed."""

TOKEN_VARIABLE = "TRISQUARE_TOKEN"

EXAMPLES = (
    "trisquare serve",
    "trisquare serve --open --idle 600",
    "trisquare serve --host 192.168.0.10 --certificate cert.pem --key key.pem",
)


def serve_command(
    host: str = option(
        "127.0.0.1", "ADDRESS", "Address to listen on; by default only this machine can connect."
    ),
    port: int = option(PORT, "N", "Port; 0 for any free port."),
    token: str | None = option(
        None,
        "TEXT",
        "Token that every request must carry, 16 letters or more; by default that of "
        "TRISQUARE_TOKEN, or a new random one. Other users of the machine see command lines.",
    ),
    max_bytes: str | None = option(None, "N", "Refuse larger requests (200M)."),
    max_pixels: str | None = option(None, "N", "Refuse pictures of more pixels (100M)."),
    max_seconds: float | None = option(
        None, "S", "Stop a request after this many seconds of computing (60)."
    ),
    max_memory: str | None = option(
        None,
        "N",
        "Bytes of memory that a request may take in addition to the program (2G); only on Linux.",
    ),
    jobs: int | None = option(
        None,
        "N",
        "Requests processed at a time; by default as many as there are cores.",
        "--jobs",
        "-j",
    ),
    certificate: Path | None = option(
        None,
        "FILE",
        "Serve by https with this certificate (PEM); without it, no browser lets a page of "
        "another machine use its camera.",
    ),
    key: Path | None = option(None, "FILE", "The certificate's private key (PEM)."),
    idle: float | None = option(None, "SECONDS", "End after this many seconds without a request."),
    grace: int = option(
        GRACE,
        "SECONDS",
        "At the end, wait this many seconds for answers that are being computed (8).",
    ),
    open_browser: bool = flag("Open the page in a browser.", "--open"),
    verbose: bool = flag(
        "Log each request on standard error: method, path, status, seconds.", "--verbose", "-v"
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Serve a page that calibrates cameras in a browser, from files or from its own camera.

    Nothing leaves the machine, and nothing is kept once it is answered. It ends with Ctrl-C.
    """
    if not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"--port must be from 0 to {LARGEST_PORT}, not {port}")
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs must be at least 1, not {jobs}")
    if idle is not None and not 0 < idle < float("inf"):
        raise ValueError(f"--idle must be positive, not {idle}")
    if grace < 0:
        raise ValueError(f"--grace must not be negative, not {grace}")
    fixed = _stated_token(token)
    if fixed is None and quiet and not open_browser:
        raise ValueError(
            f"--quiet does not print the random token: state one ({TOKEN_VARIABLE}, --token), or "
            "use --open"
        )
    if (certificate is None) != (key is None):
        raise ValueError("--certificate and --key belong together: give both")
    for file in (certificate, key):
        if file is not None:
            _check_readable(file)
    check_extra()
    from trisquare.batch.limits import JobLimits
    from trisquare.serve.app import create_app
    from trisquare.serve.limits import REQUEST_LIMITS
    from trisquare.serve.server import run_server

    limits = JobLimits.stated(
        amount(max_pixels, "--max-pixels"),
        amount(max_bytes, "--max-bytes"),
        max_seconds,
        amount(max_memory, "--max-memory"),
        defaults=REQUEST_LIMITS,
    )

    chosen = secrets.token_urlsafe(TOKEN_BYTES) if fixed is None else fixed

    def listening(address: str) -> None:
        members = {"format": SERVICE_FORMAT, "address": address, "token": chosen}
        answer(json, quiet, members, [address])
        sys.stdout.flush()
        if open_browser:
            webbrowser.open(address)

    if verbose:
        _log_to_standard_error()
    run_server(
        create_app(chosen, limits, jobs or usable_cores()),
        host,
        port,
        token=chosen,
        certificate=certificate,
        key=key,
        idle=idle,
        grace=grace,
        listening=listening,
    )


def _stated_token(token: str | None) -> str | None:
    """Return the token of the option or, failing that, of the environment; None without one."""
    name = "--token"
    if token is None:
        name, token = TOKEN_VARIABLE, os.environ.get(TOKEN_VARIABLE)
    if token is not None and not TOKEN.fullmatch(token):
        raise ValueError(f"{name} must have 16 to 200 letters, digits, _ or -")
    return token


def _log_to_standard_error() -> None:
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    log = logging.getLogger("trisquare")
    log.addHandler(handler)
    log.setLevel(logging.INFO)


def _check_readable(file: Path) -> None:
    """Raise an error that names the file if it cannot be read; OpenSSL's does not name it.

    OpenSSL opens it by name, more than once, and would wait for a pipe forever.
    """
    with reading():
        try:
            if not stat.S_ISREG(file.stat().st_mode):
                raise OSError("is no regular file")
            file.open("rb").close()
        except OSError as error:
            raise OSError(f"{file}: {error.strerror or error}") from error
