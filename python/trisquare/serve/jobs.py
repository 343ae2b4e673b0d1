"""Tasks of requests: a bounded queue, and processes that may be killed."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import anyio
from anyio.to_thread import run_sync

from trisquare.batch.limits import JobLimits
from trisquare.batch.workers import Workers
from trisquare.serve.tasks import Task
from trisquare.serve.work import perform

MAX_ACCEPTED = 64
"""Maximum number of requests that are received, waiting or running; more are refused."""


FOLDER_PREFIX = "trisquare-serve-"
"""Prefix of the names of folders in the system's folder for temporary files."""


class BusyError(Exception):
    """The maximum number of requests is already accepted."""


class AbandonedError(Exception):
    """The client no longer waits for the answer."""


class Jobs:
    """Processes, a queue before them, and a folder for each request.

    Parameters
    ----------
    limits : JobLimits
        Limits of each request.
    processes : int
        Number of tasks that run at a time.
    most_accepted : int
        Maximum number of requests at a time, including waiting ones.

    Attributes
    ----------
    folder : Path
        Parent of the requests' folders.
    """

    def __init__(
        self, limits: JobLimits, processes: int, most_accepted: int = MAX_ACCEPTED
    ) -> None:
        self.limits = limits
        self._workers = Workers(limits, perform)
        self._processes = processes
        self._most_accepted = most_accepted
        self._accepted = 0
        self._lock = threading.Lock()
        self._turns: anyio.CapacityLimiter | None = None
        remove_abandoned_folders()
        self.folder, self._held = own_folder()

    def accept(self) -> Place:
        """Reserve a place, which the end of its ``with`` block frees.

        Raises
        ------
        BusyError
            If all places are taken.
        OSError
            If its folder cannot be created.
        """
        with self._lock:
            if self._accepted >= self._most_accepted:
                raise BusyError
            folder = Path(tempfile.mkdtemp(dir=self.folder))
            self._accepted += 1
        return Place(self, folder)

    def give_back(self, place: Place) -> None:
        """Free a place for another request."""
        shutil.rmtree(place.folder, ignore_errors=True)
        with self._lock:
            self._accepted -= 1

    async def do(
        self, task: Task, folder: Path, until_left: Callable[[], Awaitable[None]]
    ) -> dict[str, Any]:
        """Run a task on the files of a folder and return its record.

        Raises
        ------
        AbandonedError
            If `until_left` returned first: a waiting task is not run, a running one is stopped.
        """
        if self._turns is None:  # it belongs to the running event loop
            self._turns = anyio.CapacityLimiter(self._processes)
        records: list[dict[str, Any]] = []
        async with anyio.create_task_group() as group:

            async def watch() -> None:
                await until_left()
                self._workers.abandon(task)
                group.cancel_scope.cancel()

            group.start_soon(watch)
            # A thread that has started is always waited for, even if it is cancelled.
            record, _ = await run_sync(self._workers.do, task, str(folder), limiter=self._turns)
            records.append(record)
            group.cancel_scope.cancel()
        if not records:
            raise AbandonedError
        return records[0]

    def close(self) -> None:
        """End all processes and delete all files."""
        self._workers.close()
        with suppress(OSError):
            shutil.rmtree(self.folder)
        if self._held is not None:
            os.close(self._held)  # releases the folder's lock
            self._held = None


class Place:
    """A request's place among the accepted ones, with its own folder; a context manager."""

    def __init__(self, jobs: Jobs, folder: Path) -> None:
        self._jobs, self.folder = jobs, folder

    def __enter__(self) -> Place:
        return self

    def __exit__(self, *error: object) -> None:
        self._jobs.give_back(self)


def own_folder() -> tuple[Path, int | None]:
    """Create a folder and lock it until the returned descriptor is closed or the process ends."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX))
        held = _hold(folder)
        if folder.is_dir():  # else another process removed it as abandoned before it was locked
            return folder, held


def remove_abandoned_folders() -> None:
    """Remove the folders of servers that were killed, with the pictures in them."""
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER_PREFIX}*"):
        held = _hold(folder)
        if held is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(held)


def _hold(folder: Path) -> int | None:
    """Lock a folder until the descriptor is closed; None if it is locked, or cannot be."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    with suppress(OSError):  # such as a folder of another user
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(held)
        else:
            return held
    return None
