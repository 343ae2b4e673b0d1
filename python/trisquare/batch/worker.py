"""Main loop of a separate process that does one job after another, within limits.

The process may crash, be killed, or run out of memory without affecting others. It computes in one
thread, since there is a process for every core.
"""

from __future__ import annotations

import faulthandler
import json
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO, Protocol

from trisquare._core import __version__
from trisquare.batch.jobs import Job
from trisquare.batch.limits import JobLimits
from trisquare.errors import code_members, error_members

Answer = tuple[dict[str, Any], "str | None"]
"""A record, and the calibration as JSON if there is one."""

READY = "ready"

RECORD_FORMAT = "trisquare-batch-record/1"

# Jobs are sent as pickles, since a lens may be among their options. Answers are lines of JSON: data
# from a process that has read untrusted files must not be unpickled.


def calibrated(job: Job, limits: JobLimits) -> Answer:
    """Calibrate one camera.

    Raises
    ------
    TrisquareError, TypeError, ValueError, OSError
        As `calibrate`.
    """
    from trisquare.calibration.calibrate import calibrate
    from trisquare.images.video import is_video

    options = dict(job.options)
    initial = options.get("initial")
    if isinstance(initial, str | os.PathLike):
        from trisquare.formats import load_camera

        options["initial"] = load_camera(initial).camera
    if not any(map(is_video, job.photographs)):
        options.pop("frames", None)  # it is for the cameras of the batch that have one
    result = calibrate(
        list(job.photographs),
        max_pixels=limits.max_pixels,
        max_bytes=limits.max_bytes,
        threads=1,
        **options,
    )
    return success(job, result), result.to_json()


def success(job: Job, result: Any) -> dict[str, Any]:
    """Return the record of a calibrated camera."""
    from trisquare.camera.camera import named_numbers
    from trisquare.results.calibration_warning import warning_members

    return {
        **_heading(job, "done"),
        "image_size": list(result.camera.image_size),
        "model": result.camera.model,
        "values": named_numbers(result.camera),
        "std": dict(result.std),
        "rms_px": result.rms,
        "noise_scale": result.noise_scale,
        "planes": sum(plane.is_used for plane in result.planes),
        "warnings": warning_members(result.warnings),
    }


class AnyJob(Protocol):
    """A job of the processes: a `Job`, or a task of another room."""

    @property
    def name(self) -> str:
        """Name in records."""

    @property
    def photographs(self) -> tuple[str, ...]:
        """Files."""


def failure(job: AnyJob, code: str, text: str) -> dict[str, Any]:
    """Return the record of a job that failed without an exception."""
    return failed_with(job, code_members(code, text))


def failed_with(job: AnyJob, error: dict[str, Any]) -> dict[str, Any]:
    """Return the record of a job that failed with an error, given as in `error_members`."""
    return {**_heading(job, "failed"), "error": error}


def _heading(job: AnyJob, status: str) -> dict[str, Any]:
    return {
        "format": RECORD_FORMAT,
        "name": job.name,
        "status": status,
        "photographs": list(job.photographs),
        "software": __version__,
    }


def serve() -> None:
    """Do the jobs from standard input until it ends, and write answers to standard output.

    Anything else that is printed there goes to standard error.
    """
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent process
    jobs = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    work, limits = pickle.load(jobs)
    prepare(limits)
    _say(answers, READY)
    while True:
        try:
            job, folder = pickle.load(jobs)
        except EOFError:
            return  # the parent process has ended
        with suppress(OSError):
            os.chdir(folder)
        try:
            _say(answers, attempted(work, job, limits))
        except BrokenPipeError:
            return


def prepare(limits: JobLimits) -> None:
    """Load what jobs need, in one thread, and limit their memory."""
    import cv2
    import numpy as np

    cv2.setNumThreads(1)
    import trisquare.measurement.find
    import trisquare.measurement.measure  # noqa: F401

    np.linalg.inv(np.eye(100))  # OpenBLAS allocates its buffer now; it ends a process if it cannot
    try:
        import resource

        with open("/proc/self/statm") as account:
            loaded = int(account.read().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):
        return  # only Linux states the memory in use, and only Unix limits it
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    bound = loaded + int(limits.max_memory)
    with suppress(ValueError, OSError, OverflowError):
        resource.setrlimit(
            resource.RLIMIT_AS,
            (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard),
        )


def attempted(work: Callable[..., Answer], job: AnyJob, limits: JobLimits) -> Answer:
    """Do a job; every failure is a record.

    A watchdog thread ends the process if it takes too long.
    """
    seconds = min(limits.max_seconds, threading.TIMEOUT_MAX)
    try:
        try:
            faulthandler.dump_traceback_later(seconds, exit=True, file=sys.stderr)
        except RuntimeError as error:  # no memory for the watchdog's thread
            raise MemoryError from error
        return work(job, limits)
    except BaseException as error:  # a panic of the core is not an Exception
        members = error_members(error)
        if members["code"] == MemoryError.__name__:
            members["text"] += f" (max_memory allows {limits.max_memory / 1e9:.3g} GB)"
        return failed_with(job, members), None
    finally:
        faulthandler.cancel_dump_traceback_later()


def _say(stream: BinaryIO, answer: object) -> None:
    stream.write(json.dumps(answer, allow_nan=False).encode() + b"\n")
    stream.flush()
