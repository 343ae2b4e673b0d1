"""A service that calibrates cameras: a photograph goes in, JSON comes out.

uvicorn service:app
curl --data-binary @photo.jpg 'http://localhost:8000/calibrations?model=auto'
"""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path

import cv2
from fastapi import FastAPI, HTTPException, Request, Response

import trisquare as ts

THREADS = os.cpu_count() or 1
"""Calibrations at a time; the core gives up Python's lock while it computes."""

MOST_WAITING = 8 * THREADS
"""Photographs accepted at a time; whoever comes next is told to come again."""

MOST_BYTES = 32 << 20
"""Of a photograph's file."""


@asynccontextmanager
async def lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Keep one pool of threads while the service runs."""
    cv2.setNumThreads(1)  # the pool shares out the cores already
    with ThreadPoolExecutor(THREADS) as pool:
        app.state.pool, app.state.accepted = pool, 0
        yield


app = FastAPI(lifespan=lifespan)


@app.post("/calibrations")
async def calibrations(
    request: Request,
    model: str = "radial2",
    tone: str | None = None,
    targets: str = "squares",
) -> Response:
    """Calibrate the camera that took the photograph in the request's body."""
    state = request.app.state
    if state.accepted >= MOST_WAITING:
        raise HTTPException(503, "too many photographs at a time", {"Retry-After": "5"})
    state.accepted += 1
    try:
        photo = await _body(request)
        calibration = await asyncio.get_running_loop().run_in_executor(
            state.pool, _calibrated, photo, model, tone, targets
        )
    finally:
        state.accepted -= 1
    return Response(calibration.to_json(), media_type="application/json")


async def _body(request: Request) -> bytes:
    """Receive a photograph, and no more than is allowed."""
    received = bytearray()
    async for part in request.stream():
        received += part
        if len(received) > MOST_BYTES:
            raise HTTPException(413, f"a photograph may have {MOST_BYTES >> 20} MB")
    return bytes(received)


def _calibrated(photo: bytes, model: str, tone: str | None, targets: str) -> ts.Calibration:
    """Calibrate from an encoded photograph, in a thread of the pool."""
    with tempfile.TemporaryDirectory() as folder:
        # From a file: trisquare refuses what is not whole; cv2.imdecode does not.
        path = Path(folder, "photograph")
        path.write_bytes(photo)
        try:
            if targets.lower().endswith(".json"):
                raise ValueError("a layout's file is the server's: name a board")
            return ts.calibrate(path, model=model, tone=tone, targets=targets)
        except (ts.TrisquareError, ValueError) as error:
            reason = {
                "error": type(error).__name__,
                "message": str(error).replace(f"{folder}{os.sep}", ""),
            }
            raise HTTPException(_status(error), reason) from error


def _status(error: Exception) -> int:
    """Tell wrong arguments, what is no picture, and one that shows too little."""
    if isinstance(error, ts.ImageError):
        return 415
    return 422 if isinstance(error, ts.TrisquareError) else 400
