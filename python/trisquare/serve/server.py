"""The server: its address, and when it ends."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import closing, suppress
from ipaddress import ip_address
from pathlib import Path

import uvicorn
from starlette.applications import Starlette

from trisquare.serve.request_log import RequestLog

BACKLOG = 128
"""Maximum number of connections that wait to be accepted."""

ALONE = {4: "127.0.0.1", 6: "::1"}
"""Loopback addresses, by IP version."""

OUTSIDE = {4: "192.0.2.1", 6: "2001:db8::1"}
"""Addresses outside every local network (RFC 5737, RFC 3849): the route to them gives the machine's
own address in its network."""


class Server(uvicorn.Server):
    """A server that reports when it listens, and ends after a time without requests."""

    def __init__(
        self, config: uvicorn.Config, idle: float | None, listening: Callable[[], None]
    ) -> None:
        super().__init__(config)
        self._idle, self._asked, self._since = idle, 0, time.monotonic()
        self._listening = listening

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and then report it; a signal sent earlier could be lost."""
        await super().startup(sockets)
        if self.started:
            self._listening()

    async def on_tick(self, counter: int) -> bool:
        """Return whether to end."""
        requests, answering = self.server_state.total_requests, self.server_state.tasks
        if answering or requests > self._asked:
            self._asked, self._since = requests, time.monotonic()
        is_idle = self._idle is not None and time.monotonic() - self._since > self._idle
        return await super().on_tick(counter) or is_idle


def run_server(
    app: Starlette,
    host: str,
    port: int,
    *,
    token: str,
    certificate: Path | None,
    key: Path | None,
    idle: float | None,
    grace: int,
    listening: Callable[[str], None],
) -> None:
    """Serve until Ctrl-C or SIGTERM, or until there is no request for `idle` seconds.

    Requests in progress then have `grace` seconds. `listening` is called with the address of the
    page, once signals are handled.

    Raises
    ------
    ValueError
        If the address cannot be bound, or certificate and key are invalid.
    """
    config = uvicorn.Config(
        RequestLog(app),
        log_level="warning",
        access_log=False,  # the token is in the addresses; RequestLog leaves it out
        server_header=False,
        proxy_headers=False,  # headers of proxies are not used
        ssl_certfile=certificate,
        ssl_keyfile=key,
        timeout_graceful_shutdown=grace,
    )
    scheme = "http" if certificate is None else "https"
    with closing(app.state.jobs):
        try:
            config.load()
        except OSError as error:
            raise ValueError(f"{certificate}: not a certificate with the key {key}") from error
        with _bound(host, port) as opened, suppress(KeyboardInterrupt):  # the usual way to end
            port = opened.getsockname()[1]
            address = f"{scheme}://{_reachable(host, opened)}:{port}/?token={token}"
            Server(config, idle, lambda: listening(address)).run(sockets=[opened])


def _reachable(host: str, opened: socket.socket) -> str:
    """Return the host for addresses; if it stands for all, the machine's address in its network."""
    address = ip_address(opened.getsockname()[0])
    if address.is_unspecified:
        host = ALONE[address.version]
        with socket.socket(opened.family, socket.SOCK_DGRAM) as way, suppress(OSError):
            way.connect((OUTSIDE[address.version], 9))  # sends nothing
            host = way.getsockname()[0]
    return f"[{host}]" if ":" in host else host


def _bound(host: str, port: int) -> socket.socket:
    """Return a socket bound to an address, or raise ValueError, which names it."""
    try:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        opened = socket.socket(family, kind)
        try:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            opened.bind(place)
            opened.listen(BACKLOG)  # before the address is reported, so that requests can follow
        except OSError:
            opened.close()
            raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(f"cannot listen on {host}, port {port}: {reason}") from error
    return opened
