"""Execution of jobs on an executor: a bounded number at a time, each with a result."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any

from trisquare._support.arrays import Frozen
from trisquare._support.log import LOG
from trisquare._support.terminal_text import printable
from trisquare._support.threads import usable_cores
from trisquare._support.writing import PathLike
from trisquare.batch.jobs import Job, faulty_job
from trisquare.batch.limits import JobLimits
from trisquare.results.calibration import Calibration

if TYPE_CHECKING:
    from concurrent.futures import Future

    from trisquare.batch.store import Store
    from trisquare.batch.worker import Answer

WINDOW = 256
"""Number of jobs submitted at a time: enough for a hundred processes, with little memory."""


@dataclass(frozen=True, slots=True, eq=False)
class JobResult(Frozen):
    """Result of a job.

    Attributes
    ----------
    job : Job
    record : mapping
        The line of ``results.jsonl``: ``format``, ``name``, ``status`` (``"done"`` or
        ``"failed"``), ``photographs``, ``software``, and either ``image_size``, ``model``,
        ``values``, ``std``, ``rms_px``, ``noise_scale``, ``planes`` and ``warnings``, or ``error``
        as in `error_members`. With `output` also ``key``, which identifies the job's inputs and
        options; a job that is done has ``file``, the path of the camera's file in `output`, and
        ``bytes``, its size; a job that failed has ``limits``, and ``removed`` if the file of an
        earlier result was removed.
    json : str or None
        The calibration as JSON; None if it failed.

    Examples
    --------
    >>> (done,) = ts.calibrate_many([ts.Job("left", ("photo.jpg",))], workers=1)
    >>> done.is_done, done.record["status"], len(done.calibration.planes)
    (True, 'done', 3)
    """

    job: Job
    record: dict[str, Any]
    json: str | None

    @property
    def is_done(self) -> bool:
        """Whether the camera is calibrated."""
        return self.json is not None

    @property
    def calibration(self) -> Calibration:
        """The calibration, without the measured edges.

        Raises
        ------
        ValueError
            If the job failed: with the error of the record.
        """
        if self.json is None:
            error = self.record["error"]
            raise ValueError(f"{self.job.name}: {error['code']}: {error['text']}")
        return Calibration.from_json(self.json)


def calibrate_many(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    output: PathLike | None = None,
    workers: int | None = None,
    window: int = WINDOW,
    retry: bool = False,
    max_pixels: int | None = None,
    max_bytes: int | None = None,
    max_seconds: float | None = None,
    max_memory: float | None = None,
) -> Iterator[JobResult]:
    """Calibrate many cameras in parallel, in processes that may crash without affecting others.

    Parameters
    ----------
    jobs : iterable of Job
        Read as they are needed, so that their number is not limited. A job with the name of an
        earlier one fails. Up to `window` jobs are read ahead, and nothing is yielded while the next
        one is waited for: for jobs that arrive one by one, as from a queue, call this for each,
        ``calibrate_many([job], executor)``, from threads of your own. Names need not differ then.
    executor : concurrent.futures.Executor, optional
        Executor that runs the jobs: of processes, of threads, Dask's (``Client.get_executor()``) or
        MPI's (``mpi4py.futures.MPIPoolExecutor()``). By default threads of this process. Each
        worker has a separate process that does the jobs, in one thread, and ends with the worker.
    output : path, optional
        Folder of results, as in `trisquare batch`: jobs whose results it has are not done again,
        and not yielded. Summaries are not written: `trisquare batch` with the same inputs
        and options, ``-o`` the folder and ``--limits`` a file, writes them without calibrating
        again.
    workers : int, optional
        Number of jobs at a time without an `executor`, by default one for each processor.
    window : int
        Maximum number of jobs that are submitted and not yet finished.
    retry : bool
        Whether jobs that failed, by the records in `output`, are done again.
    max_pixels, max_bytes : int, optional
        Limits of a picture and of its file: larger ones are refused by the header.
    max_seconds : float, optional
        Time limit of a job, after which its process is killed.
    max_memory : float, optional
        Bytes that a job may take in addition to the program; only on Linux. Limits that are not
        given are those of ``TRISQUARE_MAX_PIXELS``, ``_MAX_BYTES``, ``_MAX_SECONDS`` and
        ``_MAX_MEMORY`` of the environment, or else 500 million, 2 GB, 300 s and 4 GB.

    Yields
    ------
    JobResult
        In the order in which they finish. Every error of a job is in its result. The logger
        ``trisquare`` has an entry for each, of the level INFO, or WARNING if it failed.

    Raises
    ------
    OSError
        If `output` cannot be written to, or another run writes to it.
    BrokenExecutor
        If the `executor` itself has failed; finished results are in `output`.
    TypeError, ValueError
        For bad arguments.

    Examples
    --------
    >>> jobs = [ts.Job("left", ("photo.jpg",), {"tone": "srgb"})]
    >>> for done in ts.calibrate_many(jobs, workers=1):
    ...     print(done.job.name, round(done.calibration.camera.fx))
    left 902
    """
    limits = JobLimits.stated(max_pixels, max_bytes, max_seconds, max_memory)
    for name, value in (("workers", 1 if workers is None else workers), ("window", window)):
        if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
            raise ValueError(f"{name} must be a positive whole number, not {value!r}")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise TypeError(
            f"executor must have the method submit(), but a {type(executor).__name__} has none"
        )
    if executor is not None and workers is not None:
        raise ValueError("the executor has its own workers: give either workers or executor")
    return _calibrated(jobs, executor, output, workers, window, retry, limits)


def _calibrated(
    jobs: Iterable[Job],
    executor: Executor | None,
    output: PathLike | None,
    workers: int | None,
    window: int,
    retry: bool,
    limits: JobLimits,
) -> Iterator[JobResult]:
    from trisquare.batch.store import Store

    with ExitStack() as stack:
        store = None
        if output is not None:
            store = stack.enter_context(Store(output, limits, retry=retry))
        submit = stack.enter_context(Submission(executor, workers, limits))
        # Closed before the executor is, so that waiting jobs are not started.
        for result in stack.enter_context(closing(finished(jobs, submit, store, window))):
            error, name = result.record.get("error"), printable(result.job.name)
            if error is None:
                LOG.info("%s: done", name)
            else:
                LOG.warning("%s: %s: %s", name, error["code"], printable(error["text"]))
            yield result
        if store is not None:
            store.finish()


class Submission:
    """Submits jobs to an executor, or to threads of its own; a context manager.

    Parameters
    ----------
    executor : Executor or None
    workers : int or None
        Number of threads, without an executor; by default one for each processor.
    limits : JobLimits
    work : callable, optional
        Function to run in place of the calibration; see `Workers`.
    """

    def __init__(
        self,
        executor: Executor | None,
        workers: int | None,
        limits: JobLimits,
        work: Callable[[Job, JobLimits], Answer] | None = None,
    ) -> None:
        from trisquare.batch.worker import calibrated
        from trisquare.batch.workers import Workers, do_in_thread_process

        work = calibrated if work is None else work
        self._own: Executor | None = None
        self._workers: Workers | None = None
        if executor is None:
            from concurrent.futures import ThreadPoolExecutor

            self._workers = Workers(limits, work)
            self._own = executor = ThreadPoolExecutor(workers or usable_cores())
            do: Callable[[Job, str], Answer] = self._workers.do
        else:
            do = partial(do_in_thread_process, limits=limits, work=work)
        self._executor, self._do = executor, do

    def __call__(self, job: Job) -> Future[Answer]:
        """Submit a job; its files are relative to this process's folder."""
        return self._executor.submit(self._do, job, os.getcwd())

    def __enter__(self) -> Submission:
        return self

    def __exit__(self, *error: object) -> None:
        if self._workers is not None and self._own is not None:
            if any(error):
                self._workers.close()  # so that running jobs are not waited for
            self._own.shutdown(cancel_futures=True)
            self._workers.close()


def finished(
    jobs: Iterable[Job],
    submit: Callable[[Job], Future[Answer]],
    store: Store | None = None,
    window: int = WINDOW,
) -> Generator[JobResult, None, None]:
    """Yield the results of jobs as they finish, at most `window` of them submitted at a time.

    Jobs with results in the store are not done again, and results are stored before being yielded.
    """
    from queue import SimpleQueue

    waiting: dict[Future[Answer], tuple[Job, str]] = {}
    ready: SimpleQueue[Future[Answer]] = SimpleQueue()
    try:
        for job, key in _to_do(jobs, store):
            if job.fault is not None:
                yield _stored(job, key, _fault(job), store)
                continue
            future = submit(job)
            waiting[future] = job, key
            future.add_done_callback(ready.put)
            while len(waiting) >= window or not ready.empty():
                future = ready.get()
                yield _result(*waiting.pop(future), future, store)
        while waiting:
            future = ready.get()
            yield _result(*waiting.pop(future), future, store)
    finally:
        for future in waiting:
            future.cancel()


def _to_do(jobs: Iterable[Job], store: Store | None) -> Iterator[tuple[Job, str]]:
    """Yield the jobs to do and, for the store, the digests of what their results depend on."""
    seen: set[str] = set()
    for number, given in enumerate(jobs, 1):
        job = given
        if not isinstance(job, Job):
            raise TypeError(f"jobs must be of the class Job, not {type(job).__name__}")
        if job.identity in seen:
            origin = job.origin or f"job {number}"
            text = f"an earlier job has the name {job.name!r}, or one that gives the same file name"
            job = faulty_job(origin, text)
        seen.add(job.identity)
        key = "" if store is None else job.key
        if store is None or not store.is_done(job, key):
            yield job, key


def _fault(job: Job) -> Answer:
    from trisquare.batch.worker import failure

    return failure(job, "ValueError", job.fault or ""), None


def _result(job: Job, key: str, future: Future[Answer], store: Store | None) -> JobResult:
    """Return the result of a job, also if its executor could not do it."""
    from concurrent.futures import BrokenExecutor, CancelledError

    from trisquare.batch.worker import failure

    try:
        answer = future.result()
    except BrokenExecutor:
        raise
    except CancelledError as error:
        raise BrokenExecutor(
            "the executor cancelled jobs: run the batch again to continue it"
        ) from error
    except Exception as error:  # such as Dask's, whose workers died of the job
        answer = failure(job, "WorkerDiedError", f"{type(error).__name__}: {error}"), None
    return _stored(job, key, answer, store)


def _stored(job: Job, key: str, answer: Answer, store: Store | None) -> JobResult:
    record, json = answer
    if store is not None:
        record = store.add(job, key, answer)
    return JobResult(job, record, json)
