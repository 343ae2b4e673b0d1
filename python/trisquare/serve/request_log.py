"""A log entry for each request."""

from __future__ import annotations

import time

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from trisquare._support.log import LOG
from trisquare._support.terminal_text import printable

ERROR_HEADER = "X-Trisquare-Error"
"""Header with the code of an error in an answer."""


class RequestLog:
    """Logs method, path, status, code and seconds of every request to the logger ``trisquare``.

    The query after the path is left out: it includes the token.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and log its result."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status, began = "no answer", time.monotonic()

        async def noted(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                code = Headers(raw=message["headers"]).get(ERROR_HEADER, "")
                status = f"{message['status']} {code}".rstrip()
            await send(message)

        try:
            await self._app(scope, receive, noted)
        finally:
            asked = printable(f"{scope['method']} {scope['path']}")
            LOG.info("%s: %s, %.3f s", asked, status, time.monotonic() - began)
