"""Processes that jobs may crash, for any thread or process that has jobs."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from typing import Any

from trisquare.batch.jobs import Job
from trisquare.batch.limits import JobLimits
from trisquare.batch.worker import READY, Answer, AnyJob, calibrated, failure

ATTEMPTS = 2
"""Number of attempts at a job: its process may have been killed because of another one."""

LARGEST_SIZE = 2**62
"""Upper limit of numbers that OpenCV reads from the environment."""

ENDING = 5.0
"""Seconds for a process that closed its output to end by itself, so that its exit is known."""

ALLOCATION_FAILED = "SIGABRT"
"""Signal by which a process ends itself if compiled code fails or cannot allocate memory; Python's
own allocations raise ``MemoryError`` instead."""

KILLED = "SIGKILL"
"""Signal by which the system ends a process if memory runs out."""

ONE_THREAD = {
    **{f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "RAYON")},
    "OPENCV_FFMPEG_THREADS": "1",
}
"""Environment variables that the libraries read when they are loaded, or a video is opened."""

KEEPS_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(2**25), "MALLOC_TRIM_THRESHOLD_": str(2**26)}
"""Environment variables for glibc: memory that a job frees is kept for the next one. New pages take
4 % of a job's time."""

START = "import sys; sys.path[:] = {path!r}; from trisquare.batch.worker import serve; serve()"


class ProcessDiedError(Exception):
    """A process ended before it answered."""


class Workers:
    """Processes that do jobs, started when they are needed and reused.

    Parameters
    ----------
    limits : JobLimits
    work : callable
        Function of a job and the limits that returns a record, and the calibration as JSON or None.
        It is pickled.
    """

    def __init__(self, limits: JobLimits, work: Any = calibrated) -> None:
        self._limits, self._setup = limits, pickle.dumps((work, limits))
        self._idle: list[_Process] = []
        self._all: set[_Process] = set()
        self._doing: dict[int, _Process | None] = {}
        self._lock = threading.Lock()
        self._is_closed = False
        self.owner = os.getpid()

    def do(self, job: AnyJob, folder: str) -> Answer:
        """Do a job in one of the processes, and in a new one if that one dies.

        Files are relative to the folder. Many threads may call this at a time; each then has its
        own process.
        """
        try:
            return self._attempts(job, folder)
        finally:
            with self._lock:
                self._doing.pop(id(job), None)

    def abandon(self, job: AnyJob) -> None:
        """End the process that does a job, which then fails."""
        with self._lock:
            process = self._doing.get(id(job))
            if process is not None:
                self._doing[id(job)] = None
                process.kill()

    def _attempts(self, job: AnyJob, folder: str) -> Answer:
        question, how = pickle.dumps((job, folder)), ""
        for attempt in range(ATTEMPTS):
            process = self._take(is_new=attempt > 0)
            with self._lock:
                self._doing[id(job)] = process
            try:
                record, calibration = process.ask(question)
            except ProcessDiedError:
                how = process.end(ENDING)
                seconds = process.seconds
                with self._lock:
                    self._all.discard(process)
                    is_abandoned = self._doing[id(job)] is None
                if is_abandoned:
                    return failure(
                        job, "AbandonedError", "nobody waits for the result any more"
                    ), None
                if seconds >= self._limits.max_seconds:
                    allowed = f"max_seconds allows {self._limits.max_seconds:g}"
                    return failure(job, "TimeLimitError", f"takes too long ({allowed})"), None
                continue
            with self._lock:
                self._idle.append(process)
            return record, calibration
        text = f"its process died {ATTEMPTS} times ({how})"
        pixels = f"or lower max_pixels ({self._limits.max_pixels})"
        if how == ALLOCATION_FAILED:
            memory = f"{self._limits.max_memory / 1e9:.3g} GB"
            text = (
                f"its process ended itself {ATTEMPTS} times ({how}): compiled code does so if it "
                "gets no memory, and so does a decoder that crashes on a damaged file. Raise "
                f"max_memory ({memory}), {pixels}"
            )
            return failure(job, "MemoryError", text), None
        if how == KILLED:
            advice = f"run fewer jobs at a time, {pixels}"
            text = f"probably the system is out of memory, {text}: {advice}"
        return failure(job, "WorkerDiedError", text), None

    def close(self) -> None:
        """End all processes; no job can be done any more."""
        with self._lock:
            self._is_closed = True
            processes, self._all, self._idle = self._all, set(), []
        for process in processes:
            process.end()

    def _take(self, *, is_new: bool) -> _Process:
        """Return a running process; the death of an idle one does not count as an attempt."""
        with self._lock:
            while self._idle and not is_new:
                process = self._idle.pop()
                if process.is_running:
                    return process
                self._all.discard(process)
                process.end()
            if self._is_closed:
                raise RuntimeError("the batch has ended")
            process = _Process(self._setup, self._limits)
            self._all.add(process)
            return process


class _Process:
    """One process, with communication over its standard input and output."""

    def __init__(self, setup: bytes, limits: JobLimits) -> None:
        environment = {
            **os.environ,
            **ONE_THREAD,
            **KEEPS_MEMORY,
            # For formats whose headers only OpenCV reads; it then refuses to read the picture.
            "OPENCV_IO_MAX_IMAGE_PIXELS": str(min(limits.max_pixels, LARGEST_SIZE)),
            "OPENCV_LOG_LEVEL": "SILENT",
        }
        self._process = subprocess.Popen(
            [sys.executable, "-c", START.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        self.seconds = 0.0
        self._setup: bytes | None = setup

    def ask(self, question: bytes) -> Any:
        """Send a pickled job and return the answer, or raise ProcessDiedError."""
        try:
            if self._setup is not None:
                self._send(self._setup)
                self._setup = None
                if self._receive() != READY:
                    raise ProcessDiedError
            start = time.monotonic()
            self._send(question)
            try:
                return self._receive()
            finally:
                self.seconds = time.monotonic() - start
        except (OSError, ValueError) as error:
            raise ProcessDiedError from error

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End the process at once; waiting for its answer then raises an error."""
        self._process.kill()

    def end(self, patience: float = 0.0) -> str:
        """End the process and return how it ended."""
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            try:
                if stream is not None:
                    stream.close()
            except OSError:  # unsent data
                pass
        code = self._process.wait()
        if code >= 0:
            return f"exit code {code}"
        try:
            return signal.Signals(-code).name
        except ValueError:
            return f"signal {-code}"

    def _send(self, pickled: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(pickled)
        self._process.stdin.flush()

    def _receive(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.endswith(b"\n"):
            raise ProcessDiedError
        return json.loads(line)


class _ThreadWorkers:
    """The process of a thread; it ends with the thread, or the interpreter."""

    def __init__(self, limits: JobLimits, work: Any) -> None:
        self.workers = Workers(limits, work)
        weakref.finalize(self, self.workers.close)


_threads = threading.local()


def do_in_thread_process(job: Job, folder: str, limits: JobLimits, work: Any) -> Answer:
    """Do a job in the process of this thread, whichever executor the thread belongs to."""
    workers_of_thread: dict[tuple[JobLimits, Any], _ThreadWorkers] = vars(_threads).setdefault(
        "kept", {}
    )
    thread_workers = workers_of_thread.get((limits, work))
    # After a fork the inherited processes belong to the parent.
    if thread_workers is None or thread_workers.workers.owner != os.getpid():
        thread_workers = workers_of_thread[limits, work] = _ThreadWorkers(limits, work)
    return thread_workers.workers.do(job, folder)
