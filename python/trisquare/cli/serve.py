"""`trisquare serve`: a page that calibrates, in a browser."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import webbrowser
from pathlib import Path

from trisquare.cli.console import answer
from trisquare.cli.options import JSON, QUIET, flag, option
from trisquare.images.limits import parse_amount
from trisquare.serve import check_extra

SERVICE_FORMAT = "trisquare-service/1"

PORT = 8765
LARGEST_PORT = 65535
TOKEN_BYTES = 24

EXAMPLES = (
    "trisquare serve",
    "trisquare serve --open",
    "trisquare serve --host 192.168.0.10 --certificate cert.pem --key key.pem",
)


def serve_command(
    host: str = option("127.0.0.1", "ADDRESS", "Listen here; by default for this machine alone."),
    port: int = option(PORT, "N", "Port; 0 for any that is free."),
    token: str | None = option(
        None, "TEXT", "What every request must bring; by default another one each time."
    ),
    max_bytes: str | None = option(None, "N", "Refuse larger requests (200M)."),
    max_pixels: str | None = option(None, "N", "Refuse pictures of more pixels (100M)."),
    jobs: int | None = option(
        None,
        "N",
        "Requests worked on at a time; by default as many as there are cores.",
        "-j",
        "--jobs",
    ),
    certificate: Path | None = option(
        None, "FILE", "Serve by https: other devices' browsers give their camera to no other page."
    ),
    key: Path | None = option(None, "FILE", "The certificate's private key."),
    open_browser: bool = flag("Open the page in a browser.", "--open"),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Serve a page that calibrates cameras in a browser, from files or from its own camera.

    Nothing leaves the machine, and nothing is kept. It ends with Ctrl-C.
    """
    check_extra()
    import uvicorn

    from trisquare.serve.app import create_app
    from trisquare.serve.limits import request_limits

    if not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"--port must be from 0 to {LARGEST_PORT}, not {port}")
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs must be at least 1, not {jobs}")
    if token is not None and not (token.isascii() and token.isalnum() and len(token) >= 16):
        raise ValueError("--token must have 16 or more letters and digits")
    if (certificate is None) != (key is None):
        raise ValueError("--certificate and --key belong together: give both")
    limits = request_limits(
        None if max_pixels is None else parse_amount(max_pixels, "--max-pixels"),
        None if max_bytes is None else parse_amount(max_bytes, "--max-bytes"),
    )
    listening = _listening(host, port)
    token = token or secrets.token_urlsafe(TOKEN_BYTES)
    scheme = "http" if certificate is None else "https"
    shown = f"[{host}]" if ":" in host else host
    address = f"{scheme}://{shown}:{listening.getsockname()[1]}/?token={token}"
    app = create_app(token, limits, jobs or os.cpu_count() or 1)
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,  # the token is in the addresses
        server_header=False,
        ssl_certfile=certificate,
        ssl_keyfile=key,
        timeout_graceful_shutdown=1,
    )
    config.load()  # a damaged certificate is told before the address
    answer(json, quiet, {"format": SERVICE_FORMAT, "address": address}, [address])
    sys.stdout.flush()
    if open_browser:
        webbrowser.open(address)
    uvicorn.Server(config).run(sockets=[listening])


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens, or raise ValueError, which names the address."""
    try:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(place)
    except OSError as error:
        raise ValueError(f"cannot listen on {host}:{port}: {error.strerror or error}") from error
    return listening
