"""Damage the files of every reader: none may hang, exhaust memory, or fail without a reason.

    python fuzz/readers.py [--cases 100000] [--seed 1] [NAME...]

Each reader runs in a process of its own, so that a hang or a crash ends only that process. A file
that is rejected with the wrong error, too slowly or with too much memory is kept in ``fuzz/found``.
"""

from __future__ import annotations

import argparse
import ctypes
import io
import json
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from batches import record_of
from camera_files import FILES
from damage import damaged
from raw_files import dng
from videos import moving, turned_clockwise

import trisquare as ts
from trisquare import simulate
from trisquare._support.paths import read_text
from trisquare._support.terminal_text import printable
from trisquare.analysis.comparison import compare
from trisquare.analysis.diagnosis import diagnose
from trisquare.batch.fleet import Fleet
from trisquare.batch.limits import JobLimits
from trisquare.batch.manifest import manifest_jobs
from trisquare.batch.page import summary_page
from trisquare.batch.requirements import read_requirements
from trisquare.batch.store import RECORDS, Store
from trisquare.batch.summary import columns, rows, write_csv
from trisquare.cli.app import main as command
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.sheets.layout import parse_layout
from trisquare.images.exif import stated_focal_length
from trisquare.images.frame_choice import choose_frames
from trisquare.images.orientation import with_orientation
from trisquare.images.pixels import picture_size
from trisquare.images.reading import read_photograph
from trisquare.images.video import ENCODERS, Video
from trisquare.serve.work import Task, perform
from trisquare.undistortion.undistort import Undistorter
from trisquare.undistortion.video import undistort_video

FOUND = Path(__file__).parent / "found"
SLOWEST = 5.0
"""Maximum processor time per file, in seconds, over all threads."""

LARGEST = 500.0
"""Maximum peak memory of a reader's process, in MB, including Python and the libraries."""

PATIENCE = 20.0
"""Wall-clock time, in seconds, after which a process is killed."""

SIZE, SMALL = (640, 480), (64, 48)
"""Size of the cameras' pictures, and of encoded pictures."""

PROCESSES = multiprocessing.get_context("spawn")
"""Not forked: a forked process would inherit locks held by threads that it does not have."""

MAX_PIXELS = 50_000_000
"""Maximum number of pixels of a picture. The default, 500 million, takes 1.5 GB in colour; a
service that reads strangers' pictures sets a lower limit."""

LONGEST_REFUSAL = 2000
"""Maximum number of characters of an error message, which may quote part of the file's content."""


@dataclass(frozen=True)
class Reader:
    """A function that reads a file of a given name, with undamaged files of that kind."""

    name: str
    read: Callable[[Path], object]
    whole: tuple[bytes, ...]


def readers() -> Iterator[Reader]:
    """Yield a reader for every kind of file that strangers may provide."""
    result = _calibration()
    cameras = [result.camera, *_other_cameras()]
    for name, known in FILES.items():
        whole = tuple(text for camera in cameras if (text := _camera_file(camera, known, name)))

        def load(path: Path, own: str = known) -> object:
            return ts.Camera.load(path, format=own, image_size=SIZE)

        def load_any(path: Path, size: object = SIZE if known == "lensfun" else None) -> object:
            return ts.Camera.load(path, image_size=size)

        yield Reader(f"{known}/{name}", load, whole)
        yield Reader(f"any/{name}", load_any, whole)
    results = (result.to_json().encode(), result.to_json(edges=True).encode())
    yield Reader("result/result.json", _use_result, results)
    yield Reader("edges/edges.json", _use_edges, (result.edges[0].to_json().encode(),))
    corners = [[10, 10], [40, 11], [39, 41], [9, 40]]
    own = {"format": "trisquare-outlines/1", "squares": [{"corners": corners}]}
    shape = {"points": corners, "shape_type": "polygon", "group_id": 1, "label": "square"}
    labelme = {"shapes": [shape], "imagePath": "a.jpg", "imageWidth": 64, "imageHeight": 48}
    outlines = (_json(own), _json(labelme))
    yield Reader("outlines/a.json", lambda path: Annotations.read(path, ["a.jpg"]), outlines)
    sheets = {"sheets": [{"name": "a", "markers": {"7": [[0, 0], [1, 0], [1, 1], [0, 1]]}}]}
    yield Reader("layout/a.json", lambda path: parse_layout(str(path)), (_json(sheets),))
    square = {"centre": [320, 240], "side": 150, "tilt": 30, "inner": 0.5}
    squares = [{**square, "direction": 120 * number} for number in range(3)]
    plan = {"format": "trisquare-plan/1", "image_size": SIZE, "squares": squares}
    yield Reader("plan/a.json", lambda path: _run("predict", path), (_json(plan),))
    csv = b"name,photographs,fix,parallel\na,a.jpg;b.jpg,aspect,0-1\nb,c.jpg,,\n"
    yield Reader("manifest/jobs.csv", _use_manifest, (csv,))
    jobs = b'{"name": "a", "photographs": ["a.jpg"]}\n{"name": "b", "photographs": "b.jpg"}\n'
    yield Reader("manifest/jobs.jsonl", _use_manifest, (jobs,))
    limits = (
        b'[fx]\nnominal = 1000\nwithin = "1 %"\n[std.cx]\nmost = 0.5\n[planes]\nleast = 3\n'
        b'[std.fx]\nmost = "0.5 %"\n[warnings]\nmost = "medium"\n'
    )
    yield Reader("limits/limits.toml", read_requirements, (limits,))
    yield Reader(f"records/{RECORDS}", _use_records, (_records(),))
    whole = (_json({"outlines": [{"corners": corners}], "image_size": [64, 48], "focal": 60.0}),)
    yield Reader("service/predict.json", _use_request, whole)
    for name in ("camera.json", "camera.yaml", "camchain.yaml"):
        known = FILES[name]
        whole = tuple(text for camera in cameras if (text := _camera_file(camera, known, name)))
        yield Reader(f"undistort/{name}", _use_camera, whole)
        yield Reader(f"convert/{name}", _convert, whole)
    yield Reader("compare/result.json", lambda path: _run("compare", path, path), results)
    for suffix, whole in _pictures().items():
        yield Reader(f"picture/a{suffix}", _use_picture, whole)
    for suffix, whole in _videos().items():
        yield Reader(f"frames/a{suffix}", lambda path: choose_frames(path, 3), whole)
        yield Reader(f"undistorted/a{suffix}", _undistort_video, whole)


def _run(*words: str | Path) -> None:
    """Run the command and require that an error is one printable line."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            command([str(word) for word in words])
    except SystemExit as end:
        code, said = end.code, err.getvalue()
    told = said.removesuffix("\n")
    if code not in (0, 2, 3, 4, 5) or any(
        line != printable(line) for line in (out.getvalue() + said).split("\n")
    ):
        raise AssertionError(f"exit code {code}: {told[-400:]!r}")
    if code and told != printable(told):
        raise AssertionError(f"an error of several lines: {told[:400]!r}")
    if code:
        raise ValueError(told)


def _use_camera(path: Path) -> None:
    undistorter = Undistorter(ts.Camera.load(path))
    undistorter.undistort(np.zeros(SIZE[::-1], np.uint8))


def _convert(path: Path) -> None:
    for name in ("out.json", "out.yaml", "out.pto"):
        _run("convert", path, path.with_name(name), "--approximate")


def _use_result(path: Path) -> None:
    result = ts.Calibration.load(path)
    assert ts.Calibration.from_json(result.to_json(edges=True)) == result
    str(diagnose(result))
    compare(result, result)


def _use_edges(path: Path) -> None:
    ts.PlaneEdges.from_json(read_text(path)).to_json()


def _use_manifest(path: Path) -> None:
    for job in manifest_jobs(str(path), {}):
        assert job.key
        assert job.file_name


def _use_records(path: Path) -> None:
    with Store(path.parent, JobLimits.stated()) as store:
        fleet = Fleet.of(store.records())
        each = lambda: rows(store.records(), fleet, [])  # noqa: E731
        counts = write_csv(path.with_name("summary.csv"), each(), columns(fleet))
        summary_page(each(), fleet, counts, [])
        store.finish()


def _use_request(path: Path) -> None:
    try:
        options = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError("refused when it is received") from error
    if not isinstance(options, dict):
        raise ValueError("refused when it is received")
    before = os.getcwd()
    os.chdir(path.parent)
    try:
        record = perform(Task("predict", (), options, {}), JobLimits.stated())[0]
    except (TypeError, ValueError) as error:  # the status 400, whose text repeats the request
        raise ValueError("refused") from error
    finally:
        os.chdir(before)
    json.dumps(record, allow_nan=False)


def _use_picture(path: Path) -> None:
    picture, _ = read_photograph(path)
    stated_focal_length(path.read_bytes(), picture_size(picture))


def _undistort_video(path: Path) -> None:
    camera = _other_cameras()[0].rescaled(SMALL)
    with Video(path) as video:
        undistort_video(video, Undistorter(camera), path.with_name("out.avi"))


def _calibration() -> ts.Calibration:
    rng = np.random.default_rng(0)
    scene = simulate.random_scene(rng, image_size=SIZE)
    sides = simulate.edge_points(scene, rng, noise=0.1)
    edges = [ts.PlaneEdges.square([side[::20] for side in own]) for own in sides]
    return ts.calibrate_edges(edges, scene.camera.image_size)


def _other_cameras() -> list[ts.Camera]:
    K = np.array([[500.5, 0.0, 320.0], [0.0, 501.5, 240.0], [0.0, 0.0, 1.0]])
    equal = np.array([[500.5, 0.0, 319.5], [0.0, 500.5, 239.5], [0.0, 0.0, 1.0]])
    return [
        ts.Camera(K, [-0.1, 0.02, 0.001, -0.002, 0.0], SIZE, "brown"),
        ts.Camera(K, [0.01, 0.001, 0.0, 0.0], SIZE, "fisheye"),
        ts.Camera(equal, [-0.1, 0, 0, 0, 0], SIZE),
    ]


def _camera_file(camera: ts.Camera, known: str, name: str) -> bytes | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        try:
            camera.save(path, known)
        except ts.LensModelError:
            return None
        return path.read_bytes()


def _records() -> bytes:
    done = (record_of(ts.Job(name, ("a.jpg",)), key="k") for name in "ab")
    failed = {"name": "c", "status": "failed", "photographs": ["c.jpg"], "key": "k"}
    failed |= {"error": {"code": "DetectionError", "text": "none"}, "limits": {"max_seconds": 1.0}}
    return b"".join(_json(record) + b"\n" for record in (*done, failed))


def _json(members: object) -> bytes:
    return json.dumps(members).encode()


def _pictures() -> dict[str, tuple[bytes, ...]]:
    from PIL import Image

    rng = np.random.default_rng(0)
    grey = cv2.GaussianBlur(rng.integers(0, 256, (48, 64), np.uint8), (0, 0), 2)
    deep, colour = (
        grey.astype(np.uint16) * 257,
        cv2.merge([grey, grey.T.copy().reshape(48, 64), grey]),
    )

    def encoded(suffix: str, *pictures: np.ndarray) -> tuple[bytes, ...]:
        return tuple(cv2.imencode(suffix, picture)[1].tobytes() for picture in pictures)

    def by_pillow(kind: str, **options: object) -> bytes:
        file = io.BytesIO()
        Image.fromarray(colour).save(file, kind, **options)
        return file.getvalue()

    jpeg = encoded(".jpg", grey, colour)
    turned = with_orientation(by_pillow("JPEG", exif=Image.Exif()), 6)
    pictures = {
        ".png": (*encoded(".png", grey, deep, colour), by_pillow("PNG")),
        ".jpg": (*jpeg, by_pillow("JPEG", progressive=True), *([turned] if turned else [])),
        ".tif": (*encoded(".tif", grey, deep, deep.astype(np.float32)), by_pillow("TIFF")),
        ".webp": encoded(".webp", colour),
        ".bmp": encoded(".bmp", grey, colour),
        ".pgm": encoded(".pgm", grey, deep),
        ".jp2": encoded(".jp2", grey),
        ".gif": (by_pillow("GIF"),),
        ".avif": encoded(".avif", colour),
    }
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        print("HEIC is left out: pillow_heif is not installed")
    else:
        register_heif_opener()
        pictures[".heic"] = (by_pillow("HEIF"),)
    try:
        import rawpy  # noqa: F401
    except ImportError:
        print("raw pictures are left out: rawpy is not installed")
    else:
        pictures[".dng"] = (dng(deep),)
    return pictures


def _videos() -> dict[str, tuple[bytes, ...]]:
    frames, videos = moving(6, SMALL), {}
    others = {".mkv": "mp4v", ".flv": "\2\0\0\0"}
    with tempfile.TemporaryDirectory() as folder:
        for suffix, encoder in {**ENCODERS, **others}.items():
            path = Path(folder) / f"a{suffix}"
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*encoder), 10.0, SMALL)
            for frame in frames:
                writer.write(frame)
            writer.release()
            if path.exists() and path.stat().st_size:
                videos[suffix] = (path.read_bytes(),)
    videos[".mp4"] += (turned_clockwise(videos[".mp4"][0]),)
    return videos


@dataclass
class Progress:
    """State of a reader's process, in shared memory."""

    case: ctypes.c_long
    began: ctypes.c_double
    slowest: ctypes.c_double
    peak: ctypes.c_double

    @classmethod
    def shared(cls) -> Progress:
        """Return the state before the first case."""
        return cls(*(PROCESSES.RawValue(kind) for kind in ("l", "d", "d", "d")))


def _work(name: str, seed: int, first: int, cases: int, progress: Progress) -> None:
    """Read damaged files, with the standard error of the libraries discarded."""
    sys.stderr = os.fdopen(os.dup(2), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    os.environ["TRISQUARE_MAX_PIXELS"] = str(MAX_PIXELS)
    warnings.simplefilter("error")
    cv2.setNumThreads(1)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    reader = next(own for own in readers() if own.name == name)
    for case in range(first, cases):
        progress.began.value = np.inf
        file = _case(reader, seed, case)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            path.write_bytes(file)
            progress.case.value, progress.began.value = case, time.monotonic()
            start = time.process_time()
            why = _fault(reader, path)
            seconds = time.process_time() - start
        if why is not None:
            _keep(name, case, file, why)
        progress.slowest.value = max(progress.slowest.value, seconds)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        if peak > LARGEST >= progress.peak.value:
            _keep(name, case, file, f"{peak:.0f} MB")
        progress.peak.value = peak
        if seconds > SLOWEST:
            _keep(name, case, file, f"{seconds:.1f} s")
    progress.case.value, progress.began.value = cases, np.inf


def _fault(reader: Reader, path: Path) -> str | None:
    """Read a file and describe what is wrong; return None if it is read or properly refused."""
    try:
        reader.read(path)
    except (OSError, ts.TrisquareError, ts.LensModelError) as error:
        refusal: Exception = error
    except Exception as error:
        if type(error) is not ValueError:  # a library's subclass means nothing to a user
            return f"{type(error).__name__}: {error}"
        refusal = error
    else:
        return None
    return None if len(str(refusal)) < LONGEST_REFUSAL else f"a message: {str(refusal)[:200]} ..."


def _case(reader: Reader, seed: int, case: int) -> bytes:
    rng = random.Random(f"{seed} {reader.name} {case}")
    return damaged(rng.choice(reader.whole), reader.name, rng)


def _keep(name: str, case: int, file: bytes, why: str) -> None:
    FOUND.mkdir(exist_ok=True)
    kind, file_name = name.split("/")
    path = FOUND / f"{kind}-{case}-{file_name}"
    path.write_bytes(file)
    print(f"  {name}, case {case}: {printable(why)}; kept as {path.name}", flush=True)


def _read_whole(reader: Reader, file: bytes) -> None:
    """Read an undamaged file, which must succeed: of a refused one, no damage would be tested."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / Path(reader.name).name
        path.write_bytes(file)
        reader.read(path)


def run(reader: Reader, seed: int, cases: int) -> bool:
    """Print a reader's row of the table; return whether it had no faults."""
    for whole in reader.whole:
        _read_whole(reader, whole)
    progress = Progress.shared()
    before = set(FOUND.glob("*"))
    start, first = time.monotonic(), 0
    while first < cases:
        progress.case.value, progress.began.value = first, np.inf
        process = PROCESSES.Process(target=_work, args=(reader.name, seed, first, cases, progress))
        process.start()
        while process.is_alive() and time.monotonic() - progress.began.value < PATIENCE:
            process.join(0.2)
        first = progress.case.value
        if process.is_alive():
            process.kill()
            _keep(reader.name, first, _case(reader, seed, first), f"hangs for {PATIENCE:g} s")
            progress.slowest.value = PATIENCE
        elif process.exitcode != 0:
            why = f"the process ends with {process.exitcode}"
            _keep(reader.name, first, _case(reader, seed, first), why)
        process.join()
        first += first < cases
    numbers = (progress.slowest.value, progress.peak.value, time.monotonic() - start)
    print("| {} | {} | {:.3f} | {:.0f} | {:.0f} |".format(reader.name, cases, *numbers), flush=True)
    return set(FOUND.glob("*")) == before


def main() -> None:
    """Run every reader, or those whose names have a given prefix."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="how the readers' names begin; by default all")
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    chosen = [own for own in readers() if own.name.startswith(tuple(asked.names) or "")]
    if not chosen:
        parser.error(f"no reader begins so; there are {', '.join(own.name for own in readers())}")
    print("| reader | files | slowest, s | memory, MB | all, s |\n| --- | --- | --- | --- | --- |")
    well = [run(reader, asked.seed, asked.cases) for reader in chosen]
    sys.exit(0 if all(well) else 1)


if __name__ == "__main__":
    main()
