"""A service that calibrates cameras: a photograph goes in, JSON comes out.

uvicorn service:app
curl --data-binary @photo.jpg 'http://localhost:8000/calibrations?model=auto'
"""

from __future__ import annotations

import asyncio
import logging
import os
import tempfile
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

import trisquare as ts

HAS_AFFINITY = hasattr(os, "sched_getaffinity")  # not on macOS
CORES = len(os.sched_getaffinity(0)) if HAS_AFFINITY else os.cpu_count()

PROCESSES = int(os.environ.get("SERVICE_PROCESSES") or CORES or 1)
"""Calibrations at a time, each in a process of its own."""

MAX_WAITING = 8 * PROCESSES
"""Photographs accepted at a time; whoever comes next is told to come again."""

MAX_BYTES = 32 << 20
"""Of a photograph's file."""

LIMITS: dict[str, Any] = {
    "max_bytes": MAX_BYTES,
    "max_pixels": 50_000_000,  # by the header, before anything is decoded
    "max_seconds": 20.0,  # then the process is killed
    "max_memory": 1e9,  # bytes beside the 80 MB that a process has from the start; on Linux
}
"""Of one calibration."""

OPTIONS = ("model", "tone", "targets")
"""What a client may choose: others name files, which are the server's."""

HELP = "faq.html"
"""Where this service has the page that explains the codes."""


@asynccontextmanager
async def lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Keep one pool while the service runs: a process stands beside each of its threads."""
    with ThreadPoolExecutor(PROCESSES) as pool:
        app.state.pool, app.state.accepted = pool, 0
        app.state.turns = asyncio.Semaphore(PROCESSES)
        yield


logging.basicConfig(level="INFO", format="%(asctime)s %(levelname)s %(name)s: %(message)s")

app = FastAPI(lifespan=lifespan)


class RefusedError(Exception):
    """An answer that is an error, with one of trisquare's codes and what else is said of it."""

    def __init__(self, code: str, text: str, **more: Any) -> None:
        super().__init__(text)
        help_page = f"{HELP}#{code.lower()}"
        self.members = {**more, "code": code, "text": text, "help": help_page}


@app.exception_handler(RefusedError)
async def refused(request: Request, error: RefusedError) -> JSONResponse:
    """Answer with an error in the shape of all JSON of trisquare."""
    code = error.members["code"]
    headers = {"Retry-After": "5"} if code == "BusyError" else None
    return JSONResponse({"error": error.members}, ts.http_status(code), headers)


@app.exception_handler(HTTPException)
async def unknown(request: Request, error: HTTPException) -> JSONResponse:
    """Answer likewise where there is no such address or method."""
    code = {404: "NotFoundError", 405: "MethodError"}.get(error.status_code, "InternalError")
    answer = await refused(request, RefusedError(code, str(error.detail)))
    answer.headers.update(error.headers or {})  # as the methods that an address has
    return answer


@app.exception_handler(Exception)
async def failed(request: Request, error: Exception) -> JSONResponse:
    """Answer likewise where the service itself is at fault; the log has the traceback."""
    return await refused(request, RefusedError("InternalError", "the service has failed"))


@app.get("/health")
async def health(request: Request) -> dict[str, Any]:
    """Say that the service runs, and how much it has to do."""
    return {"version": ts.__version__, "accepted": request.app.state.accepted}


@app.post("/calibrations")
async def calibrations(
    request: Request,
    model: str = "radial2",
    tone: str | None = None,
    targets: str = "squares",
) -> Response:
    """Calibrate the camera that took the photograph in the request's body."""
    if others := sorted(set(request.query_params) - set(OPTIONS)):
        raise RefusedError("ValueError", f"unknown: {others[0]}; known: {', '.join(OPTIONS)}")
    if request.headers.get("content-type", "").startswith(("multipart/", "application/json")):
        raise RefusedError("ImageError", "send the photograph's file as the body, and nothing else")
    if targets.lower().endswith(".json"):
        raise RefusedError("ValueError", "a layout's file is the server's: name a board")
    state = request.app.state
    if state.accepted >= MAX_WAITING:
        raise RefusedError("BusyError", "too many photographs at a time: come again")
    state.accepted += 1
    try:
        photo = await _body(request)
        options = {"model": model, "tone": tone, "targets": targets}
        async with state.turns:
            if await request.is_disconnected():  # while it waited
                raise RefusedError("AbandonedError", "the client left")
            result = await asyncio.to_thread(_calibrated, state.pool, photo, options)
    finally:
        state.accepted -= 1
    job = result.record["name"]  # by which the log calls it
    if result.json is None:
        raise RefusedError(**result.record["error"], job=job)  # with what was found and rejected
    return Response(result.json, media_type="application/json", headers={"X-Job": job})


async def _body(request: Request) -> bytes:
    """Receive a photograph, and no more than is allowed."""
    received = bytearray()
    try:
        async for part in request.stream():
            received += part
            if len(received) > MAX_BYTES:
                raise RefusedError("TooLargeError", f"a photograph may have {MAX_BYTES >> 20} MB")
    except ClientDisconnect as error:
        raise RefusedError("AbandonedError", "the client left") from error
    return bytes(received)


def _calibrated(pool: ThreadPoolExecutor, photo: bytes, options: dict[str, Any]) -> ts.JobResult:
    """Calibrate from an encoded photograph, in a process that may be killed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "photograph")
        path.write_bytes(photo)
        job = ts.Job(Path(folder).name, path, options)  # a name that tells lines of the log apart
        (result,) = ts.calibrate_many([job], pool, **LIMITS)
    if not result.is_done:  # a client need not know where its file was
        error = result.record["error"]
        error["text"] = error["text"].replace(f"{folder}{os.sep}", "")
    return result
