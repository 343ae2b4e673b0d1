"""What runs in a process of its own: one job after another, within limits.

The process may die of a job, be killed for it, or run out of memory without anybody else suffering
for it. It computes in one thread, since there is a process for every core.
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

# Jobs come as pickles, for a lens may be among their options. Answers are lines of JSON: what has
# read the files of strangers is not to be unpickled.


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
    """What processes do: a `Job`, or a task of another room."""

    @property
    def name(self) -> str:
        """What records call it."""

    @property
    def photographs(self) -> tuple[str, ...]:
        """Files."""


def failure(job: AnyJob, code: str, text: str) -> dict[str, Any]:
    """Return the record of a job that failed without an error of its own."""
    return failed_with(job, code_members(code, text))


def failed_with(job: AnyJob, error: dict[str, Any]) -> dict[str, Any]:
    """Return the record of a job that failed with an error, as `error_members` has it."""
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
    """Do the jobs that come on standard input until it ends; answers go to standard output.

    What else is printed there, goes to standard error.
    """
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started this
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
            return  # who started this has ended
        with suppress(OSError):
            os.chdir(folder)
        try:
            _say(answers, attempted(work, job, limits))
        except BrokenPipeError:
            return


def prepare(limits: JobLimits) -> None:
    """Load what jobs need, in one thread, and bound the memory that they may take."""
    import cv2
    import numpy as np

    cv2.setNumThreads(1)
    import trisquare.measurement.find
    import trisquare.measurement.measure  # noqa: F401

    np.linalg.inv(np.eye(100))  # so OpenBLAS has its buffer: it ends a process where it gets none
    try:
        import resource

        with open("/proc/self/statm") as account:
            loaded = int(account.read().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):
        return  # only Linux says how much there is already, and only Unix bounds it
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    bound = loaded + int(limits.max_memory)
    with suppress(ValueError, OSError, OverflowError):
        resource.setrlimit(
            resource.RLIMIT_AS,
            (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard),
        )


def attempted(work: Callable[..., Answer], job: AnyJob, limits: JobLimits) -> Answer:
    """Do a job: every failure is a record.

    A watchdog that waits for nobody ends the process if it takes too long.
    """
    seconds = min(limits.max_seconds, threading.TIMEOUT_MAX)
    try:
        try:
            faulthandler.dump_traceback_later(seconds, exit=True, file=sys.stderr)
        except RuntimeError as error:  # its thread has no room
            raise MemoryError from error
        return work(job, limits)
    except BaseException as error:  # a panic of the core is no Exception
        members = error_members(error)
        if members["code"] == MemoryError.__name__:
            members["text"] += f" (max_memory allows {limits.max_memory / 1e9:.3g} GB)"
        return failed_with(job, members), None
    finally:
        faulthandler.cancel_dump_traceback_later()


def _say(stream: BinaryIO, answer: object) -> None:
    stream.write(json.dumps(answer, allow_nan=False).encode() + b"\n")
    stream.flush()
