"""`trisquare batch`: many cameras, each from its own photographs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from trisquare._support.writing import write_atomically
from trisquare.batch.fleet import Fleet
from trisquare.batch.inputs import camera_pattern, find_jobs
from trisquare.batch.limits import JobLimits
from trisquare.batch.requirements import AnyRequirement, read_requirements
from trisquare.batch.run import WINDOW, Submission, finished
from trisquare.batch.store import Store
from trisquare.batch.summary import (
    Counts,
    check_parquet,
    columns,
    rows,
    write_csv,
    write_parquet,
)
from trisquare.camera.lens_models import MODELS
from trisquare.camera.settings import AUTO, METHODS, Settings
from trisquare.cli.console import answer
from trisquare.cli.framework import NOT_ALL_PASSED_EXIT, reading
from trisquare.cli.input_files import camera_alone
from trisquare.cli.options import (
    FIX,
    FRAMES,
    FREE,
    INITIAL,
    JSON,
    MAX_BYTES,
    MAX_PIXELS,
    QUIET,
    amount,
    argument,
    flag,
    listed_names,
    option,
)
from trisquare.images.pixels import TONE_CURVES, checked_tone

if TYPE_CHECKING:
    from concurrent.futures import Executor

EXAMPLES = (
    "trisquare batch line/*.jpg -o results",
    "trisquare batch fleet --camera '{serial}_*.jpg' -o results --limits limits.toml",
    "trisquare batch cameras.csv -o results --jobs 8 --model brown",
    "trisquare batch clip.mp4 line/*.jpg -o results --frames 10",
    "trisquare batch archive -o results --dask tcp://scheduler:8786",
)

FORMAT = "trisquare-batch/1"
LOG_SECONDS = 60.0
DASK_SECONDS = 10
"""Maximum time for a scheduler to answer, seconds."""

MAX_FAILED = 10
"""Maximum number of lines on cameras that failed or did not pass; the summary has all."""


def batch_command(
    inputs: list[str] = argument(
        ...,
        "INPUT",
        "Photographs, folders, patterns such as 'line?/*.jpg', or manifests (.csv, .jsonl).",
    ),
    output: Path = option(
        ...,
        "FOLDER",
        "Keep results in this folder; cameras whose results are already in it are skipped.",
        "--output",
        "-o",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
    camera: str | None = option(
        None,
        "PATTERN",
        "Group photographs into cameras by their names: '{serial}_*.jpg'. By default each "
        "photograph is a camera of its own, and so is each subfolder of the given folder.",
    ),
    jobs: int | None = option(
        None, "N", "Number of processes; by default one for each processor.", "--jobs", "-j"
    ),
    dask: str | None = option(
        None,
        "ADDRESS",
        "Run on the Dask cluster of this scheduler. Needs pip install 'trisquare[dask]'.",
    ),
    mpi: bool = flag(
        "Run on the processes of mpiexec -n N python -m mpi4py.futures -m trisquare batch. Needs "
        "mpi4py.",
        "--mpi",
    ),
    limits: Path | None = option(
        None, "FILE", "Limits for production, as TOML: cameras beyond them do not pass."
    ),
    parquet: bool = flag(
        "Write summary.parquet as well. Needs pip install 'trisquare[batch]'.", "--parquet"
    ),
    retry: bool = flag("Process the cameras that failed once more.", "--retry"),
    model: str = option(
        "radial2", "MODEL", "Lens model, as in trisquare calibrate.", offer=(*MODELS, AUTO)
    ),
    method: str = option("ml", "METHOD", "Method: ml or linear.", offer=METHODS),
    fix: list[str] | None = FIX,
    initial: Path | None = INITIAL,
    free: list[str] | None = FREE,
    tone: str | None = option(
        None, "TONE", "Tone curve: auto, srgb, linear or a gamma.", offer=TONE_CURVES
    ),
    targets: str = option("auto", "TARGETS", "Targets to search for, as in trisquare calibrate."),
    frames: int | None = FRAMES,
    lines: bool = flag("Use the scene's own straight edges as well.", "--lines"),
    max_pixels: str | None = MAX_PIXELS,
    max_bytes: str | None = MAX_BYTES,
    max_seconds: float | None = option(None, "S", "Stop a camera after this many seconds (300)."),
    max_memory: str | None = option(
        None,
        "N",
        "Bytes of memory that a camera may take in addition to the program (4G); only on Linux.",
    ),
) -> None:
    """Calibrate many cameras, each from its own photographs; an interrupted run continues."""
    bounds = JobLimits.stated(
        amount(max_pixels, "--max-pixels"),
        amount(max_bytes, "--max-bytes"),
        max_seconds,
        amount(max_memory, "--max-memory"),
    )
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs must be positive, not {jobs}")
    if (jobs is not None) + (dask is not None) + mpi > 1:
        raise ValueError("give one of --jobs, --dask and --mpi: a cluster has its own workers")
    if camera is not None:
        camera_pattern(camera)
    options = _options(method, model, fix, initial, free, tone, targets, frames, lines)
    with reading():
        requirements = [] if limits is None else read_requirements(limits)
        total = sum(1 for _ in find_jobs(inputs, camera, options))
    if parquet:
        check_parquet()
    with (
        _executor(dask, mpi) as executor,
        Store(output, bounds, retry=retry) as store,
        Submission(executor, jobs, bounds) as submit,
        _progress(total, quiet) as told,
    ):
        done = 0
        found = finished(find_jobs(inputs, camera, options), submit, store, WINDOW)
        for done, _ in enumerate(found, 1):
            told(done)
        store.finish()
        summary = _write_summary(output, store, requirements, parquet)
    members = _members(output, done, summary.counts, requirements)
    answer(json, quiet, members, _report(output, done, summary))
    if not summary.counts.all_passed:
        raise typer.Exit(NOT_ALL_PASSED_EXIT)


def _options(
    method: str,
    model: str,
    fix: list[str] | None,
    initial: Path | None,
    free: list[str] | None,
    tone: str | None,
    targets: str,
    frames: int | None,
    lines: bool,
) -> dict[str, Any]:
    """Return the options of all cameras, checked: an error is reported once, not by each camera."""
    from trisquare.detection.kinds import TargetKinds

    known = None if initial is None else camera_alone(initial)
    settings = Settings.check(method, model, listed_names(fix), known, listed_names(free), (), ())
    curve = checked_tone(tone)
    with reading():
        TargetKinds.parse(targets)
    if frames is not None and frames < 1:
        raise ValueError(f"--frames must be at least 1, not {frames}")
    if lines and method == "linear":
        raise ValueError("--lines needs --method ml")
    given = {
        "method": (settings.method, "ml"),
        "model": (settings.model, "radial2"),
        "fix": (settings.fixed, ()),
        "initial": (None if initial is None else str(initial), None),
        "free": (settings.free, ()),
        "tone": (curve, None),
        "targets": (targets, "auto"),
        "frames": (frames, None),
        "lines": (lines, False),
    }
    return {name: value for name, (value, default) in given.items() if value != default}


def _executor(dask: str | None, mpi: bool) -> AbstractContextManager[Executor | None]:
    """Return the executor of a cluster; None for processes of this machine."""
    if dask is not None:
        return dask_executor(dask)
    return mpi_executor() if mpi else nullcontext()


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Return the executor of a Dask cluster.

    Raises
    ------
    ImportError
        If Dask is not installed.
    ValueError
        If there is no answer from the address.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("--dask needs Dask: pip install 'trisquare[dask]'") from error
    import logging
    from concurrent.futures import BrokenExecutor

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # its errors are reported here
    try:
        client = Client(address, timeout=DASK_SECONDS, set_as_default=False)  # type: ignore[no-untyped-call]
    except Exception as error:  # distributed raises many classes of errors
        raise ValueError(f"{address}: no Dask scheduler answers there") from error
    with client:
        try:
            yield client.get_executor()  # type: ignore[no-untyped-call]
        except BrokenExecutor as error:
            raise ValueError(f"{address}: {error}") from error


def mpi_executor() -> Executor:
    """Return the executor of the processes that mpiexec has started.

    Raises
    ------
    ImportError
        If mpi4py is not installed, or finds no MPI.
    """
    try:
        from mpi4py.futures import MPIPoolExecutor
    except (ImportError, RuntimeError) as error:
        raise ImportError(f"--mpi needs mpi4py and an MPI library: {error}") from error
    executor: Executor = MPIPoolExecutor()
    return executor


@dataclass(frozen=True)
class _Summary:
    """What is printed of a summary: counts, rows of the first unfit cameras, and notes."""

    counts: Counts
    unfit: list[dict[str, Any]]
    notes: list[str]


def _write_summary(
    output: Path, store: Store, requirements: list[AnyRequirement], parquet: bool
) -> _Summary:
    """Write the summary's files, the page only if its extra is installed."""
    fleet = Fleet.of(store.records())
    shown = columns(fleet)

    def each() -> Iterator[dict[str, Any]]:
        return rows(store.records(), fleet, requirements)

    counts = write_csv(output / "summary.csv", each(), shown)
    if parquet:
        write_parquet(output / "summary.parquet", each(), shown)
    notes = []
    try:
        from trisquare.batch.page import summary_page
    except ImportError:
        notes.append("no summary.html, which needs pip install 'trisquare[batch]'")
    else:
        page = summary_page(each(), fleet, counts, requirements)
        write_atomically({output / "summary.html": page})
    unfit = (row for row in each() if row["status"] not in ("passed", "earlier"))
    return _Summary(counts, list(islice(unfit, MAX_FAILED)), notes)


def _members(
    output: Path, done: int, counts: Counts, requirements: list[AnyRequirement]
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "output": str(output),
        "cameras": counts.total,
        "done_now": done,
        "passed": counts.passed,
        "passed_with_high_warning": counts.passed_with_high_warning,
        "beyond_limits": counts.beyond_limits,
        "failed": counts.failed,
        "earlier": counts.earlier,
        "retake": counts.retake,
        "outlying": counts.outlying,
        "all_passed": counts.all_passed,
        "limits": [str(requirement) for requirement in requirements],
    }


def _report(output: Path, done: int, summary: _Summary) -> list[RenderableType]:
    counts = summary.counts
    noun = "camera" if counts.total == 1 else "cameras"
    high = ""
    if counts.passed_with_high_warning:
        high = f" ({counts.passed_with_high_warning} with a warning of high severity)"
    retake = f"photographs of {counts.retake} to take again"
    if counts.retake:
        retake = f"{retake} (column retake of summary.csv)"
    lines = [
        f"{output}: {counts.total} {noun} ({done} done now): {counts.passed} "
        f"passed{high}, {counts.beyond_limits} beyond the limits, {counts.failed} failed; "
        f"{retake}, {counts.outlying} unlike the others"
    ]
    if counts.earlier:
        noun, are, do = (
            ("camera", "is", "does") if counts.earlier == 1 else ("cameras", "are", "do")
        )
        lines.append(
            f"{counts.earlier} more {noun} of earlier runs, which this one was not given, {are} "
            f"kept and {do} not count"
        )
    for row in summary.unfit:
        reason = row.get("beyond_limits") or row["failure"]
        removed = row.get("removed")
        stale = f"; {removed}, of an earlier photograph, is removed" if removed else ""
        lines.append(f"{row['name']}: {row['status']}: {reason}{stale}")
    more = counts.beyond_limits + counts.failed - len(summary.unfit)
    if more > 0:
        lines.append(f"and {more} more: summary.csv")
    return [*lines, *summary.notes]


@contextmanager
def _progress(total: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """Show the progress on standard error: a bar on a terminal, else a line per minute.

    Yields a function that is called with the number of jobs done.
    """
    console = Console(stderr=True)
    if quiet:
        yield lambda done: None
    elif console.is_terminal:
        with Progress(
            TextColumn("calibrating"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        ) as bar:
            task = bar.add_task("", total=total, rate="")
            start = time.monotonic()

            def show(done: int) -> None:
                seconds = time.monotonic() - start
                bar.update(task, completed=done, rate=f"{done / max(seconds, 1e-9):.1f}/s")

            yield show
    else:
        yield _log(total)


def _log(total: int) -> Callable[[int], None]:
    start = last = time.monotonic()

    def show(done: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= LOG_SECONDS:
            last = now
            rate = done / (now - start)
            seconds_left = max(0, total - done) / rate
            print(
                f"{done} of {total} cameras, {rate:.2f}/s, {seconds_left / 60:.0f} min left",
                file=sys.stderr,
                flush=True,
            )

    return show
