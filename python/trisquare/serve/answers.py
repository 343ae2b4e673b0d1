"""Answers to all tasks: JSON members, or the content of a file.

A worker imports this module with its first task; the server, which only passes tasks on, does not.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from trisquare._support.arrays import real_array, real_number, size_of_image, whole_number
from trisquare._support.records import record_members
from trisquare.analysis.comparison import compare
from trisquare.analysis.diagnosis import diagnose
from trisquare.batch.limits import JobLimits
from trisquare.calibration.calibrate import calibrate
from trisquare.calibration.known_camera import known_camera
from trisquare.camera.camera import centred_pinhole, named_numbers
from trisquare.camera.camera_of import camera_of
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.kinds import TargetKinds
from trisquare.drawing.overlay import draw_overlay
from trisquare.formats.load_save import written
from trisquare.formats.registry import format_called
from trisquare.images.encoding import encode_image
from trisquare.images.frame_choice import choose_frames
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import as_recorded, picture_size, tone_of
from trisquare.images.reading import read_photograph
from trisquare.measurement.find import search
from trisquare.measurement.measure import measure
from trisquare.report import check_extra, report_page
from trisquare.report.pictures import shown_pixels
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import warning_members
from trisquare.results.partial_detection import partial_detections
from trisquare.results.rejected import Rejected
from trisquare.serve.guidance import SIGMA, OutlinedSquare, guide
from trisquare.serve.limits import MAX_PICTURES
from trisquare.serve.tasks import CALIBRATION_OPTIONS, Task
from trisquare.undistortion.undistort import Undistorter

SHOWN = "image/jpeg"

FRAMES = 10
"""Default number of frames of a video."""

SIDE_POINTS = 8
"""Number of drawn points of a measured side."""

Answered = tuple[dict[str, Any], bytes | None]
"""Members of the answer, and the content of a file if the answer is a file."""


def _find(task: Task, limits: JobLimits) -> Answered:
    """Find outlines, or measure the edges at outlines that were drawn, and move these onto them."""
    picture = as_recorded(_picture(task, limits))
    size = picture_size(picture)
    kinds = TargetKinds.parse(_targets(task))
    annotations_given = task.options.get("outlines")
    if annotations_given is None:
        candidates = search(picture, kinds).found
        outlined = [_outlined(target) for target in candidates if not isinstance(target, Rejected)]
        rejected = [candidate for candidate in candidates if isinstance(candidate, Rejected)]
    else:
        annotations = Annotations.read(_object(annotations_given, "outlines"), task.photographs[:1])
        measured = measure(picture, kinds, tone_of(picture, None), annotations.on(0, size))
        outlined, rejected = _figure_outlines(measured.figures), measured.rejected
    members = {
        "image_size": list(size),
        "found": outlined,
        "rejected": [record_members(candidate) for candidate in rejected],
    }
    if _flag(task, "guide"):
        members["prediction"] = _guidance(members["found"], size, None)
    return members, None


def _outlined(target: Any) -> dict[str, Any]:
    """Return a target's outline: corners and, for a square, its curved sides and its hole."""
    members = {"kind": target.kind, "corners": _rounded(target.quad)}
    outline = getattr(target, "outline", None)
    if outline is not None:
        members["sides"] = [_rounded(side[::4]) for side in outline.outer.sides]
        if outline.inner is not None:
            members["inner"] = _rounded(outline.inner.corners)
    return members


def _figure_outlines(figures: Sequence[Any]) -> list[dict[str, Any]]:
    """Return the outlines of measured squares; the second figure of a plane is a frame's hole."""
    outlined: dict[int, dict[str, Any]] = {}
    for figure in figures:
        (detection,) = partial_detections([figure])
        corners = _rounded(_side_intersections(figure.points, detection.corners))
        if figure.plane in outlined:
            outlined[figure.plane]["inner"] = corners
        else:
            thinned = [points[:: max(len(points) // SIDE_POINTS, 1)] for points in figure.points]
            sides = [_rounded(points) for points in thinned]
            members = {"kind": detection.kind, "corners": corners, "sides": sides}
            outlined[figure.plane] = members
    return list(outlined.values())


def _side_intersections(sides: Sequence[Any], approximate: Any) -> Any:
    """Return the intersections of four curved sides, (4, 2); `approximate` is some pixels off.

    Corner i lies between sides i - 1 and i. A quarter of a side is approximated by a line.
    """

    def end(points: Any, corner: Any) -> Any:
        """Return the line through the quarter of a side that is nearest to a corner."""
        distance = np.hypot(*(points - corner).T)
        nearest_points = points[np.argsort(distance)[: max(len(points) // 4, 2)]]
        centre = nearest_points.mean(axis=0)
        normal = np.linalg.svd(nearest_points - centre)[2][1]
        return np.array([*normal, -normal @ centre])

    meeting = np.array(
        [
            np.cross(end(sides[i - 1], corner), end(sides[i], corner))
            for i, corner in enumerate(approximate)
        ]
    )
    return meeting[:, :2] / meeting[:, 2:]


def _rounded(points: Any) -> list[list[float]]:
    return [[round(float(x), 2), round(float(y), 2)] for x, y in points]


def _calibrate(task: Task, limits: JobLimits) -> Answered:
    options = {name: task.options[name] for name in CALIBRATION_OPTIONS if name in task.options}
    options["targets"] = _targets(task)
    drawn = task.options.get("outlines")
    result = calibrate(
        list(task.photographs),
        outlines=None if drawn is None else _object(drawn, "outlines"),
        threads=1,
        max_pixels=limits.max_pixels,
        max_bytes=limits.max_bytes,
        **options,
    )
    values = named_numbers(result.camera)
    return {
        "result": json.loads(result.to_json(edges=True)),
        "parameters": [
            {"name": name, "value": value, "std": result.std.get(name)}
            for name, value in values.items()
            if name in result.std or value != 0
        ],
        "warnings": warning_members(result.warnings),
        "diagnosis": diagnose(result).members(),
    }, None


def _predict(task: Task, limits: JobLimits) -> Answered:
    options = task.options
    if "image_size" not in options or "outlines" not in options:
        raise ValueError('a prediction needs "image_size" and "outlines"')
    size = size_of_image(_pair(options["image_size"]))
    return _guidance(options["outlines"], size, options), None


def _pair(value: Any) -> tuple[int, int]:
    if not (isinstance(value, list) and len(value) == 2):
        raise ValueError('"image_size" must be [width, height]')
    return value[0], value[1]


def _guidance(
    outlines: Any, size: tuple[int, int], options: Mapping[str, Any] | None
) -> dict[str, Any]:

    if not isinstance(outlines, list):
        raise TypeError('"outlines" must be a list')
    squares, unusable = [], []
    for number, outline in enumerate(outlines):
        members = _object(outline, f"outlines[{number}]")
        kind = members.get("kind", "square")
        if kind not in ("square", "frame", "tag"):
            unusable.append(str(kind))  # its outline is not enough for a prediction
            continue
        path = f"outlines[{number}]"
        inner, sides = members.get("inner"), members.get("sides")
        squares.append(
            OutlinedSquare(
                real_array(members.get("corners"), f"{path}.corners", (4, 2)),
                None if inner is None else real_array(inner, f"{path}.inner", (4, 2)),
                None if sides is None else [real_array(side, path, (None, 2)) for side in sides],
            )
        )
    options = options or {}
    camera = None
    if options.get("camera") is not None:
        camera = _camera_of_members(_object(options["camera"], "camera"))
    elif options.get("focal") is not None:
        camera = centred_pinhole(real_number(options["focal"], "focal"), size)
    sigma = real_number(options.get("sigma", SIGMA), "sigma")
    guidance = guide(squares, size, camera, sigma=sigma)
    if unusable and guidance.std is None:
        advice = (
            f"A {unusable[0]} is found. Predictions do not include it: calibrate to see its effect."
        )
        guidance = replace(guidance, advice=advice)
    return asdict(guidance)


def _camera_of_members(members: Mapping[str, Any]) -> Any:
    Path("camera.json").write_text(json.dumps(members), "utf-8")
    return camera_of(known_camera("camera.json"))


def _overlay(task: Task, limits: JobLimits) -> Answered:
    index = task.options.get("index", 0)
    if not isinstance(index, int) or isinstance(index, bool) or index < 0:
        raise ValueError(f"index must be a whole number from 0 on, not {index!r}")
    picture = _picture(task, limits)
    calibration = _calibration(task)
    _check_size(picture, calibration.camera)
    return _jpeg(draw_overlay(picture, calibration, index=index))


def _undistort(task: Task, limits: JobLimits) -> Answered:
    picture = _picture(task, limits)
    camera = camera_of(known_camera(_file(task, "camera")))
    _check_size(picture, camera)
    balance = real_number(task.options.get("balance", 0.0), "balance")
    straight = Undistorter(camera, balance).undistort(picture)
    if _flag(task, "shown"):
        return _jpeg(_shown(straight))
    suffix = ".tif" if straight.dtype == "float32" else ".png"
    media = "image/tiff" if suffix == ".tif" else "image/png"
    return _content(encode_image(straight, f"undistorted{suffix}"), media, f"undistorted{suffix}")


def _preview(task: Task, limits: JobLimits) -> Answered:
    """Return a picture that a browser cannot read in a form that it can show."""
    return _jpeg(_shown(_picture(task, limits)))


def _frames(task: Task, limits: JobLimits) -> Answered:
    """Return frames of a video as a form, in the form in which `calibrate` accepts them."""
    count = whole_number(task.options.get("frames", FRAMES), "frames")
    if not 1 <= count <= MAX_PICTURES:
        raise ValueError(f"frames must be from 1 to {MAX_PICTURES}, not {count}")
    chosen = choose_frames(_only(task), count, limits.of_pictures)
    # RFC 7578; a random boundary, which occurs in no picture.
    boundary = secrets.token_hex(16)
    form = b"".join(
        f'--{boundary}\r\nContent-Disposition: form-data; name="picture"; '
        f'filename="frame-{frame.number}.png"\r\nContent-Type: image/png\r\n\r\n'.encode()
        + encode_image(frame.pixels, "frame.png")
        + b"\r\n"
        for frame in chosen
    )
    content = form + f"--{boundary}--\r\n".encode()
    return _content(content, f"multipart/form-data; boundary={boundary}", "frames.form")


def _report(task: Task, limits: JobLimits) -> Answered:
    check_extra()
    photographs = Photographs(list(task.photographs), limits=limits.of_pictures)
    page = report_page(_calibration(task), photographs)
    return _content(page, "text/html", "report.html")


def _convert(task: Task, limits: JobLimits) -> Answered:
    known = format_called(task.options["format"])
    camera = camera_of(known_camera(_file(task, "camera")))
    ending = known.file_names[0] if known.file_names else ""
    name = ending if ending.strip("._") and not ending.startswith(".") else f"camera{ending}"
    if "." not in name:
        name += ".txt"
    text, lost = written(camera, known, Path(name).suffix.lower(), _flag(task, "approximate"))
    members, content = _content(text.encode(), "text/plain", name)
    return {**members, "lost": None if lost is None else str(lost)}, content


def _compare(task: Task, limits: JobLimits) -> Answered:
    found = compare(known_camera(_file(task, "first")), known_camera(_file(task, "second")))
    return {
        "verdict": found.verdict,
        "same": found.same,
        "rms_px": found.rms,
        "worst_px": found.worst,
        "expected_rms_px": found.expected_rms,
        "p_value": found.p_value,
    }, None


def _picture(task: Task, limits: JobLimits) -> Any:
    return read_photograph(_only(task), limits.of_pictures)[0]


def _only(task: Task) -> str:
    """Return the picture of a task that accepts one."""
    if len(task.photographs) != 1:
        raise ValueError(f"give one picture, not {len(task.photographs)}")
    return task.photographs[0]


def _targets(task: Task) -> str:
    targets = task.options.get("targets", "auto")
    if isinstance(targets, str) and targets.lower().endswith(".json"):
        raise ValueError("a file with a layout cannot be given here: name a board")
    return str(targets)


def _object(value: Any, name: str) -> Mapping[str, Any]:
    """Return an option that must be a JSON object; a string would be the name of a file."""
    if not isinstance(value, dict):
        raise TypeError(f'"{name}" must be a JSON object, not {type(value).__name__}')
    return value


def _file(task: Task, field: str) -> str:
    if field not in task.files:
        raise ValueError(f'the file "{field}" is missing')
    return task.files[field]


def _calibration(task: Task) -> Any:
    return Calibration.from_json(Path(_file(task, "result")).read_text("utf-8"))


def _check_size(picture: Any, camera: Any) -> None:
    if picture_size(picture) != camera.image_size:
        camera_size, other = (
            "{} x {}".format(*size) for size in (camera.image_size, picture_size(picture))
        )
        raise ValueError(f"the picture has {other} pixels, but the camera is for {camera_size}")


def _flag(task: Task, name: str) -> bool:
    """Return whether an option is true; a string such as "false", which is truthy, is refused."""
    value = task.options.get(name, False)
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, not {value!r}")
    return value


def _shown(picture: Any) -> Any:
    return shown_pixels(picture, linear=picture.dtype == "float32")


def _jpeg(picture: Any) -> Answered:
    return _content(encode_image(picture, "shown.jpg"), SHOWN, "shown.jpg")


def _content(content: bytes, media: str, name: str) -> Answered:
    return {"media_type": media, "file_name": name}, content


ANSWERS: Mapping[str, Callable[[Task, JobLimits], Answered]] = {
    "find": _find,
    "calibrate": _calibrate,
    "predict": _predict,
    "overlay": _overlay,
    "undistort": _undistort,
    "preview": _preview,
    "frames": _frames,
    "report": _report,
    "convert": _convert,
    "compare": _compare,
}
"""The function for each task of `TASKS`."""
