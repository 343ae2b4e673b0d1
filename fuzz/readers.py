"""Damage what every reader of files reads: none may hang, take memory, or fail without a reason.

    python fuzz/readers.py [--cases 100000] [--seed 1] [NAME...]

Each reader works in a process of its own, which a hang or a crash cannot outlive. A file that is
refused wrongly, too slowly or with too much memory is kept in ``fuzz/found``.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import multiprocessing
import random
import re
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from camera_files import FILES

import trisquare as ts
from trisquare import simulate
from trisquare.batch.manifest import manifest_jobs
from trisquare.batch.requirements import read_requirements
from trisquare.cli.predict import planned_square, read_plan
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.sheets.layout import parse_layout
from trisquare.images.orientation import with_orientation
from trisquare.images.reading import read_photograph

FOUND = Path(__file__).parent / "found"
SLOWEST = 5.0
"""Seconds that a file may take."""

LARGEST = 500.0
"""MB that a reader's process may have at its peak, Python and the libraries included."""

PATIENCE = 20.0
"""Seconds after which a process is killed."""

PROCESSES = multiprocessing.get_context("spawn")
"""A forked process would inherit the locks of threads that it does not have."""

MOST_BYTES = 1_000_000
"""Of a damaged file."""

NUMBER = re.compile(rb"\d+(\.\d+)?")
EXTREMES = (b"0", b"-1", b"1e308", b"1e999", b"9" * 400, b"1" * 30, b"nan", b"0x7f", b"1:1:1:1")
TOKENS = (
    *(b"[", b"]", b"{", b"}", b'"', b"'", b",", b":", b"\n", b"\t", b"<", b">", b"&a", b"*a"),
    *(b"- ", b"? ", b"!!python/object:os.system", b"<<: *a", b"<!DOCTYPE a [<!ENTITY b 'c'>]>"),
    *(b"&b;", b"\x00", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xef\xbb\xbf", b"null", b"true"),
)


@dataclass(frozen=True)
class Reader:
    """What reads a file, by the file's name, and whole files of its kind."""

    name: str
    read: Callable[[Path], object]
    whole: tuple[bytes, ...]


def readers() -> Iterator[Reader]:
    """Yield every reader of files that strangers may hand in."""
    result = _calibration()
    cameras = [result.camera, *_other_cameras()]
    for name, known in FILES.items():
        whole = tuple(text for camera in cameras if (text := _camera_file(camera, known, name)))

        def load(path: Path, own: str = known) -> object:
            return ts.Camera.load(path, format=own, image_size=(640, 480))

        yield Reader(f"{known}/{name}", load, whole)
        yield Reader(f"any/{name}", ts.Camera.load, whole)
    yield Reader("result/result.json", ts.Calibration.load, (result.to_json().encode(),))
    corners = [[100, 100], [200, 110], [190, 210], [95, 200]]
    own = {"format": "trisquare-outlines/1", "squares": [{"corners": corners}]}
    shape = {"points": corners, "shape_type": "polygon", "group_id": 1, "label": "square"}
    labelme = {"shapes": [shape], "imagePath": "a.jpg", "imageWidth": 640, "imageHeight": 480}
    outlines = tuple(json.dumps(drawn).encode() for drawn in (own, labelme))
    yield Reader("outlines/a.json", lambda path: Annotations.read(path, ["a.jpg"]), outlines)
    sheets = {"sheets": [{"name": "a", "markers": {"7": [[0, 0], [1, 0], [1, 1], [0, 1]]}}]}
    yield Reader("layout/a.json", lambda path: parse_layout(str(path)), (_json(sheets),))
    square = {"centre": [320, 240], "side": 150, "tilt": 30, "direction": 120, "inner": 0.5}
    plan = {"format": "trisquare-plan/1", "image_size": [640, 480], "squares": 3 * [square]}
    yield Reader("plan/a.json", _plan, (_json(plan),))
    csv = b"name,photographs,fix,parallel\na,a.jpg;b.jpg,aspect,0-1\nb,c.jpg,,\n"
    yield Reader("manifest/jobs.csv", lambda path: list(manifest_jobs(str(path), {})), (csv,))
    jobs = b'{"name": "a", "photographs": ["a.jpg"]}\n{"name": "b", "photographs": "b.jpg"}\n'
    yield Reader("manifest/jobs.jsonl", lambda path: list(manifest_jobs(str(path), {})), (jobs,))
    limits = b'[fx]\nnominal = 1000\nwithin = "1 %"\n[std.cx]\nmost = 0.5\n[planes]\nleast = 3\n'
    yield Reader("limits/limits.toml", read_requirements, (limits,))
    for suffix, whole in _pictures().items():
        yield Reader(f"picture/a{suffix}", read_photograph, whole)


def _plan(path: Path) -> object:
    guess = _other_cameras()[0]
    return [planned_square(own, guess, None) for own in read_plan(path).objects("squares")]


def _calibration() -> ts.Calibration:
    rng = np.random.default_rng(0)
    scene = simulate.random_scene(rng)
    sides = simulate.edge_points(scene, rng, noise=0.1)
    edges = [ts.PlaneEdges.square([side[::20] for side in own]) for own in sides]
    return ts.calibrate_edges(edges, scene.camera.image_size)


def _other_cameras() -> list[ts.Camera]:
    K = np.array([[500.5, 0.0, 320.0], [0.0, 501.5, 240.0], [0.0, 0.0, 1.0]])
    equal = np.array([[500.5, 0.0, 319.5], [0.0, 500.5, 239.5], [0.0, 0.0, 1.0]])
    return [
        ts.Camera(K, [-0.1, 0.02, 0.001, -0.002, 0.0], (640, 480), "brown"),
        ts.Camera(K, [0.01, 0.001, 0.0, 0.0], (640, 480), "fisheye"),
        ts.Camera(equal, [-0.1, 0, 0, 0, 0], (640, 480)),
    ]


def _camera_file(camera: ts.Camera, known: str, name: str) -> bytes | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        try:
            camera.save(path, known)
        except ts.LensModelError:
            return None
        return path.read_bytes()


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
        file = BytesIO()
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
    }
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        print("HEIC is left out: pillow_heif is not installed")
    else:
        register_heif_opener()
        pictures[".heic"] = (by_pillow("HEIF"),)
    return pictures


def damaged(whole: bytes, rng: random.Random) -> bytes:
    """Return a file with one to four faults."""
    file = bytearray(whole)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(file) + 1)
        end = min(len(file), at + int(2 ** rng.uniform(0, 10)))
        fault = rng.randrange(8)
        if fault == 0:
            file[at : at + 1] = bytes([rng.randrange(256)])
        elif fault == 1:
            file[at:end] = rng.randbytes(end - at)
        elif fault == 2:
            del file[at:end]
        elif fault == 3:
            file[at:at] = file[at:end] * int(2 ** rng.uniform(0, 12))
        elif fault == 4:
            del file[at:]
        elif fault == 5:
            number = NUMBER.search(file, at)
            if number:
                file[slice(*number.span())] = rng.choice(EXTREMES)
        elif fault == 6:
            file[at:at] = rng.choice(TOKENS) * int(2 ** rng.uniform(0, rng.choice((1, 14))))
        else:
            other = rng.randrange(len(file) + 1)
            file[other : other + end - at] = file[at:end]
        del file[MOST_BYTES:]
    return bytes(file)


@dataclass
class Progress:
    """What a reader's process tells of itself, in memory that both sides see."""

    case: ctypes.c_long
    began: ctypes.c_double
    slowest: ctypes.c_double
    peak: ctypes.c_double

    @classmethod
    def shared(cls) -> Progress:
        """Return one that is at the first case."""
        return cls(*(PROCESSES.RawValue(kind) for kind in ("l", "d", "d", "d")))


def _work(name: str, seed: int, first: int, cases: int, progress: Progress) -> None:
    reader = next(own for own in readers() if own.name == name)
    cv2.setNumThreads(1)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / Path(name).name
        for case in range(first, cases):
            file = _case(reader, seed, case)
            path.write_bytes(file)
            progress.case.value, progress.began.value = case, time.monotonic()
            try:
                reader.read(path)
            except (ValueError, OSError, ts.TrisquareError):
                pass  # a refusal, which tests look at
            except Exception as error:
                _keep(name, case, file, f"{type(error).__name__}: {error}")
            seconds = time.monotonic() - progress.began.value
            progress.slowest.value = max(progress.slowest.value, seconds)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
            if peak > LARGEST >= progress.peak.value:
                _keep(name, case, file, f"{peak:.0f} MB")
            progress.peak.value = peak
            if seconds > SLOWEST:
                _keep(name, case, file, f"{seconds:.1f} s")
        progress.case.value, progress.began.value = cases, np.inf


def _case(reader: Reader, seed: int, case: int) -> bytes:
    rng = random.Random(f"{seed} {reader.name} {case}")
    return damaged(rng.choice(reader.whole), rng)


def _keep(name: str, case: int, file: bytes, why: str) -> None:
    FOUND.mkdir(exist_ok=True)
    kind, file_name = name.split("/")
    path = FOUND / f"{kind}-{case}-{file_name}"
    path.write_bytes(file)
    print(f"  {name}, case {case}: {why}; kept as {path.name}", flush=True)


def run(reader: Reader, seed: int, cases: int) -> bool:
    """Print the slowest file and the largest memory of a reader; return whether all is well."""
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
    print(
        f"{reader.name}: {cases} files in {time.monotonic() - start:.0f} s, slowest "
        f"{progress.slowest.value:.3f} s, {progress.peak.value:.0f} MB",
        flush=True,
    )
    return set(FOUND.glob("*")) == before


def main() -> None:
    """Run every reader, or those whose names begin as asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="how the readers' names begin; by default all")
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    chosen = [own for own in readers() if own.name.startswith(tuple(asked.names) or "")]
    if not chosen:
        parser.error(f"no reader begins so; there are {', '.join(own.name for own in readers())}")
    well = [run(reader, asked.seed, asked.cases) for reader in chosen]
    sys.exit(0 if all(well) else 1)


if __name__ == "__main__":
    main()
