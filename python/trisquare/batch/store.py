"""Folder of results, with complete files only, one run at a time, and no job done twice."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from operator import itemgetter
from pathlib import Path
from typing import Any

from trisquare._support.worded_errors import worded
from trisquare._support.writing import PathLike, replacing, write_atomically, writing
from trisquare.batch.jobs import Job
from trisquare.batch.limits import JobLimits
from trisquare.batch.records import identity_in, stated_identity
from trisquare.batch.worker import Answer

RECORDS, CAMERAS, LOCK = "results.jsonl", "cameras", ".lock"

HALF_FILE = re.compile(r"\..*\.[0-9a-f]{8}\.tmp", re.DOTALL)
"""Names that `write_atomically` and `replacing` give to incomplete files."""

BY_LIMITS = ("TimeLimitError", "WorkerDiedError", "MemoryError", "ImageError")
"""Errors that may not occur with other limits."""


class Store:
    """The results of a batch in a folder; a context manager.

    A record is a line of ``results.jsonl``, appended as soon as the camera's own file is on the
    disk or, for a job that failed, removed. `finish` puts the lines into the jobs' order.
    Lines that cannot be read as records, perhaps of another version, are kept until their jobs are
    done again. In memory there is a name and a number for each record.

    Parameters
    ----------
    folder : path
        Created if it does not exist.
    limits : JobLimits
        Limits of the jobs: those that failed because of other limits are done again.
    retry : bool
        Whether all failed jobs are done again.

    Raises
    ------
    OSError
        If it cannot be written to, or another run writes to it.
    """

    def __init__(self, folder: PathLike, limits: JobLimits, *, retry: bool = False) -> None:
        self.folder = Path(folder)
        self._limits, self._retry = vars_of(limits), retry
        self._places: dict[str, int] = {}
        self._unread: dict[str, int] = {}
        self._order: list[str] = []
        with writing(folder):
            (self.folder / CAMERAS).mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self.folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                _lock(self._lock, self.folder)
                self._remove_half_files()
                self._open()
            except BaseException:
                os.close(self._lock)
                raise

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self._close()
        os.close(self._lock)  # releases the lock

    def is_done(self, job: Job, key: str) -> bool:
        """Record that a job belongs to this run, and return whether its record remains valid."""
        self._order.append(job.identity)
        place = self._places.get(job.identity)
        if place is None:
            return False
        record = self._record_at(place)
        if record.get("key") != key or record.get("name") != job.name:
            return False
        if record["status"] == "done":
            file = self._file_of(job)
            # Records of older versions do not state the size.
            return file.is_file() and record.get("bytes") in (None, file.stat().st_size)
        by_limits = record["error"]["code"] in BY_LIMITS and record["limits"] != self._limits
        return not (self._retry or by_limits)

    def _file_of(self, job: Job) -> Path:
        return self.folder / CAMERAS / job.file_name

    def add(self, job: Job, key: str, answer: Answer) -> dict[str, Any]:
        """Write the result of a job, and return its record.

        Raises
        ------
        OSError
            If it cannot be written, as when the disk is full: no part of it remains.
        """
        record, calibration = answer
        record = {**record, "key": key}
        file = self._file_of(job)
        if calibration is None:
            record["limits"] = self._limits
            if file.is_file():  # of an earlier result, from other photographs
                record["removed"] = f"{CAMERAS}/{job.file_name}"
                # Before the record: if the run is killed in between, the job is done again.
                with writing(file):
                    file.unlink()
        else:
            content = calibration.encode()
            record |= {"file": f"{CAMERAS}/{job.file_name}", "bytes": len(content)}
            write_atomically({file: content})
        self._append(job.identity, record)
        return record

    def finish(self) -> None:
        """Put the records into the jobs' order, with those of earlier runs' cameras at the end."""
        given = set(self._order)
        order = list(dict.fromkeys([*self._order, *self._places, *self._unread]))
        places = {**self._unread, **self._places}
        path = self.folder / RECORDS
        with replacing(path) as file:
            for identity in order:
                place = places.get(identity)
                is_given = identity in given or identity in self._unread
                if place is not None and (is_given or _is_of_camera(self._record_at(place))):
                    file.write(self._line_at(place))
            self._close()  # some systems cannot replace an open file
        self._places.clear()
        self._unread.clear()
        self._open()

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield the records, in the order of their lines.

        Records of earlier runs that are not of this run's jobs have ``earlier``.
        """
        current = set(self._order)
        for identity, place in sorted(self._places.items(), key=itemgetter(1)):
            record = self._record_at(place)
            yield record if identity in current else {**record, "earlier": True}

    def __len__(self) -> int:
        return len(self._places)

    def _append(self, identity: str, record: dict[str, Any]) -> None:
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        with writing(self.folder / RECORDS):
            try:
                rest = memoryview(line)
                while rest:
                    rest = rest[os.write(self._file.fileno(), rest) :]
                os.fsync(self._file.fileno())
            except OSError:
                self._file.truncate(self._end)
                raise
        self._places[identity] = self._end
        self._end += len(line)

    def _remove_half_files(self) -> None:
        """Remove incomplete files of a run that was killed: no other run writes here."""
        for folder in (self.folder, self.folder / CAMERAS):
            with os.scandir(folder) as entries:
                for entry in entries:
                    if HALF_FILE.fullmatch(entry.name):
                        os.unlink(entry.path)

    def _open(self) -> None:
        """Index the records, the last one of each name; cut off an incomplete line."""
        path, end = self.folder / RECORDS, 0
        self._file = path.open("ab", buffering=0)
        self._lines = path.open("rb")
        for line in self._lines:
            if not line.endswith(b"\n"):
                break  # a run was killed while it wrote the line
            identity = identity_in(line)
            if identity is not None:
                self._places[identity] = end
            elif (stated := stated_identity(line)) is not None:
                self._unread[stated] = end
            end += len(line)
        self._file.truncate(end)
        self._end = end

    def _close(self) -> None:
        self._file.close()
        self._lines.close()

    def _line_at(self, place: int) -> bytes:
        self._lines.seek(place)
        return self._lines.readline()

    def _record_at(self, place: int) -> dict[str, Any]:
        record: dict[str, Any] = json.loads(self._line_at(place))
        return record


def _is_of_camera(record: Mapping[str, Any]) -> bool:
    """Return whether a record is that of a job, not of a wrong line or an empty folder."""
    return bool(record["photographs"])


def vars_of(limits: JobLimits) -> dict[str, float]:
    """Return limits in the form of a record."""
    return {name: getattr(limits, name) for name in limits.__slots__}


def _lock(descriptor: int, folder: Path) -> None:
    """Lock the folder against other runs until the file is closed or the process ends."""
    try:
        import fcntl
    except ImportError:  # Windows: no lock against a second run
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        text = f"{folder}: another run writes to this folder"
        raise worded(OSError, text, folder, error.errno, error.strerror) from error
