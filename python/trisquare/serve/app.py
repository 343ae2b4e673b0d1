"""Routes of the page and of the API behind it."""

from __future__ import annotations

import hmac
import json
import re
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from functools import partial
from importlib import resources
from typing import Any

import anyio
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from trisquare._core import __version__
from trisquare.batch.limits import JobLimits
from trisquare.camera.lens_models import MODELS
from trisquare.errors import code_members, error_members, http_status
from trisquare.formats.registry import FORMATS
from trisquare.images.sources import VIDEO_SUFFIXES
from trisquare.serve.early_answers import EarlyAnswers
from trisquare.serve.jobs import AbandonedError, BusyError, Jobs
from trisquare.serve.request_log import ERROR_HEADER
from trisquare.serve.schema import api_schema
from trisquare.serve.tasks import CONTENT, FILES, Task
from trisquare.serve.uploads import Upload, received

UPLOAD_SECONDS = 300.0
"""Maximum time for a request to arrive, seconds."""

TOKEN_HEADER = "x-trisquare-token"

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": POLICY,
    "Permissions-Policy": "camera=(self), microphone=(), geolocation=()",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the token is in the address
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}

HEADERS_OF_ERRORS: Mapping[str, Mapping[str, str]] = {
    "BusyError": {"Retry-After": "5"},
    "TokenError": {"WWW-Authenticate": "Token"},
}

MEDIA_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}

OWN_ADDRESS = re.compile(r'(?<=")\./([\w.-]+\.(?:js|css))(?=")')
"""References from the page's own files to each other."""

UPLOAD_TIMEOUT = 408
"""Status of a request that does not arrive in time; one that computes too long has another."""


def create_app(token: str, limits: JobLimits, processes: int, **queue: int) -> Starlette:
    """Return the application.

    Parameters
    ----------
    token : str
        Token that every request must have, as the parameter ``token`` or in a header.
    limits : JobLimits
        Limits of each request.
    processes : int
        Number of requests that are computed at a time.
    **queue
        ``most_accepted`` of `Jobs`.
    """
    jobs = Jobs(limits, processes, **queue)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            jobs.close()

    api = [
        Route("/api/schema", _answering(lambda: api_schema(limits))),
        Route("/api/status", _answering(lambda: _status(limits))),
        *(
            Route(f"/api/{name}", partial(_run, jobs, name), methods=["POST"])
            for name in (
                *("find", "calibrate", "predict", "overlay", "undistort"),
                *("preview", "frames", "report", "compare"),
            )
        ),
        Route("/api/convert/{format}", partial(_run, jobs, "convert"), methods=["POST"]),
    ]
    page = [Route("/", _own_file), Route("/{name}", _own_file)]
    app = Starlette(
        routes=[*api, *page],
        lifespan=lifespan,
        exception_handlers={HTTPException: _refused, Exception: _failed},
    )
    # A redirect would go to the host that a request states, with the token in the address.
    app.router.redirect_slashes = False
    app.add_middleware(Guard, token=token, max_bytes=limits.max_bytes)
    app.add_middleware(EarlyAnswers, most_bytes=limits.max_bytes)
    app.state.jobs = jobs
    return app


class Guard:
    """Refuses requests without the token or with too many bytes, and adds headers to answers."""

    def __init__(self, app: ASGIApp, token: str, max_bytes: int) -> None:
        self._app, self._token, self._max_bytes = app, token.encode(), max_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(name.lower().encode(), text.encode()) for name, text in HEADERS.items()]
                message = {**message, "headers": [*message["headers"], *own]}
            await send(message)

        request = Request(scope)
        given = request.query_params.get("token") or request.headers.get(TOKEN_HEADER, "")
        if not hmac.compare_digest(given.encode(), self._token):
            refusal = problem("TokenError", "the token is missing or wrong")
            await refusal(scope, receive, with_headers)
            return
        try:
            stated = int(request.headers.get("content-length", "0"))
        except ValueError:
            stated = 0
        if stated > self._max_bytes:
            await self._too_large(stated)(scope, receive, with_headers)
            return
        arrived = 0

        async def counted() -> Message:
            nonlocal arrived
            message = await receive()
            arrived += len(message.get("body", b""))
            if arrived > self._max_bytes:
                raise HTTPException(413, f"more than {self._max_bytes} bytes, as max_bytes allows")
            return message

        await self._app(scope, counted, with_headers)

    def _too_large(self, stated: int) -> Response:
        text = f"has {stated} bytes, more than the {self._max_bytes} that max_bytes allows"
        return problem("TooLargeError", text)


def problem(code: str, text: str, status: int | None = None, **more: Any) -> JSONResponse:
    """Return an error answer, by default with the status of its code."""
    headers = {ERROR_HEADER: code, **HEADERS_OF_ERRORS.get(code, {})}
    error = {**code_members(code, text), **more}
    return JSONResponse({"error": error}, status or http_status(code), headers)


def _not_kept(error: OSError) -> JSONResponse:
    return problem("OSError", f"the upload cannot be stored: {error.strerror}")


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    codes = {404: "NotFoundError", 405: "MethodError", 413: "TooLargeError"}
    code = codes.get(error.status_code, "ValueError")
    answer = problem(code, error.detail, error.status_code)
    answer.headers.update(error.headers or {})  # such as the methods of an address
    return answer


async def _failed(request: Request, error: Exception) -> Response:
    return problem("InternalError", f"{type(error).__name__}: please report it")


def _answering(members: Callable[[], Any]) -> Callable[[Request], Any]:
    async def answer(request: Request) -> Response:
        return JSONResponse(members())

    return answer


def _status(limits: JobLimits) -> dict[str, Any]:
    return {
        "version": __version__,
        "max_bytes": limits.max_bytes,
        "max_pixels": limits.max_pixels,
        "formats": [{"name": known.name, "title": known.title} for known in FORMATS],
        "models": [*MODELS, "auto"],
        "videos": sorted(VIDEO_SUFFIXES),
    }


async def _own_file(request: Request) -> Response:
    """Return a file of the page, with the token added to references if it is a parameter."""
    name = request.path_params.get("name", "index.html")
    static = (resources.files("trisquare.serve") / "static").iterdir()
    file = {own.name: own for own in static}.get(name)
    suffix = name[name.rfind(".") :]
    if file is None or suffix not in MEDIA_TYPES:
        raise HTTPException(404, f"there is no {name!r}")
    text, token = file.read_text("utf-8"), request.query_params.get("token")
    if token:
        text = OWN_ADDRESS.sub(rf"./\1?token={token}", text)
    return Response(text, media_type=MEDIA_TYPES[suffix])


async def _run(jobs: Jobs, name: str, request: Request) -> Response:
    """Receive a request, run its task, and answer."""
    try:
        place = jobs.accept()
    except BusyError:
        return problem("BusyError", "too many requests at a time: try again")
    except OSError as error:
        return _not_kept(error)
    with place:
        try:
            with anyio.fail_after(UPLOAD_SECONDS):
                upload = await received(request, place.folder, FILES[name])
        except (ValueError, TypeError) as error:
            return problem(**error_members(error))
        except TimeoutError:
            text = "the request takes too long to arrive"
            return problem("TimeLimitError", text, UPLOAD_TIMEOUT)
        except ClientDisconnect:
            return problem("AbandonedError", "the client has left")
        except OSError as error:
            return _not_kept(error)
        task = _task(name, request, upload)
        try:
            record = await jobs.do(task, place.folder, partial(_until_left, request))
        except AbandonedError:
            return problem("AbandonedError", "the client has left")
        if record["status"] == "failed":
            return problem(**record["error"])
        if "media_type" in record:
            disposition = f'attachment; filename="{record["file_name"]}"'
            headers = {"Content-Disposition": disposition}
            if record.get("lost"):
                headers["X-Trisquare-Lost"] = json.dumps(record["lost"])
            content = (place.folder / CONTENT).read_bytes()
            return Response(content, media_type=record["media_type"], headers=headers)
        del record["status"]
        return JSONResponse(record)


def _task(name: str, request: Request, upload: Upload) -> Task:
    options = dict(upload.options)
    if "format" in request.path_params:
        options["format"] = request.path_params["format"]
    return Task(name, upload.photographs, options, upload.files)


async def _until_left(request: Request) -> None:
    """Return when the client has left; the body must have been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
