"""Delay of early answers until the rest of the request has arrived."""

from __future__ import annotations

import anyio
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LINGERING = 30.0
"""Maximum time, in seconds, for the rest of a request to arrive once the answer is known."""


class EarlyAnswers:
    """Receives the rest of a request's body before its answer is sent.

    A server closes the connection after an early answer. A proxy that is still sending then reports
    a bad gateway (502) to its client in place of the answer.

    Parameters
    ----------
    app : ASGI application
    most_bytes : int
        Maximum size of a body; the rest of a larger one is not waited for.
    """

    def __init__(self, app: ASGIApp, most_bytes: int) -> None:
        self._app, self._most_bytes = app, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers, arrived, is_whole = Request(scope).headers, 0, False

        async def noted() -> Message:
            nonlocal arrived, is_whole
            message = await receive()
            arrived += len(message.get("body", b""))
            is_whole = not message.get("more_body", False)  # also if the client has left
            return message

        async def later(message: Message) -> None:
            # A client that asks first ("Expect") needs the answer before it sends the body.
            is_asked = headers.get("expect") is not None and not arrived
            if message["type"] == "http.response.start" and not is_asked:
                with anyio.move_on_after(LINGERING):
                    while not is_whole and self._is_acceptable(headers, arrived):
                        await noted()
            await send(message)

        await self._app(scope, noted, later)

    def _is_acceptable(self, headers: Headers, arrived: int) -> bool:
        stated = headers.get("content-length", "")
        return max(arrived, int(stated) if stated.isdecimal() else 0) <= self._most_bytes
