"""`trisquare measure`: lengths, angles and areas on the plane of a square."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isclose
from pathlib import Path
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import separated
from trisquare._support.lengths import METRES, Length
from trisquare._support.number_text import listed, plus_minus
from trisquare._support.writing import write_atomically
from trisquare.analysis.measure import (
    CLICKED_STD,
    FAR,
    MEASUREMENT_FORMAT,
    Measurement,
    check_inside,
    extrapolation_on,
    measure,
)
from trisquare.analysis.rectify import TopView
from trisquare.analysis.rectify import rectify as rectified
from trisquare.calibration.locate import HOLE, Located, located
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.cli.console import answer, coded_lines, progress_bar, texts_and_codes
from trisquare.cli.framework import reading
from trisquare.cli.input_files import of_size, read_camera
from trisquare.cli.options import JSON, QUIET, argument, flag, option
from trisquare.cli.pictures_drawn import check_depth, check_outputs
from trisquare.detection.kinds import TAG_SEARCHES
from trisquare.images.encoding import encode_image
from trisquare.images.orientation import OrientationTag
from trisquare.images.pixels import picture_size
from trisquare.images.reading import read_photograph
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.plane import Plane

RECTANGLE = "rectangle"
"""Kind of planes whose side may be the shorter or the longer one."""

NEARLY_AS_NEAR = 2.0
"""Ratio of extrapolations up to which a second plane counts as nearly as near."""

MIN_SHOWN = 64
"""Minimum size of a view from above (px): a smaller one is probably a mistake."""

EXAMPLES = (
    "trisquare measure photo.jpg --camera camera.json --side 50mm 312,440 518,402",
    "trisquare measure photo.jpg --camera camera.json --plane 2 90,80 130,85 120,140",
    "trisquare measure later.jpg --camera camera.json --side 50mm 312,440 518,402",
    "trisquare measure photo.jpg --camera camera.json --rectify above.png",
)


def measure_command(
    photo: Path = argument(..., "PHOTO", "The photograph that shows the square."),
    points: list[str] | None = argument(
        None,
        "[X,Y]...",
        "Pixels on the square's plane: two for a length, three for an angle, in order round a "
        "polygon for its area.",
        allows_dash=True,
    ),
    camera: Path | None = option(
        None,
        "FILE",
        "The camera that took it (required): a calibration's JSON, or any format that "
        "convert reads (then taken as exact).",
    ),
    plane: int | None = option(
        None,
        "N",
        "Index of the plane in the photograph, from 0 on; by default the plane that contains all "
        "points, or else the one that contains most of them and is nearest, relative to its size.",
    ),
    side: str | None = option(
        None,
        "LENGTH",
        "Side of the square (on a board: of a cell; of a4, 16:9 and the like: the shorter one), "
        "such as 50mm; by default the one that the calibration states, or 1. Units: "
        f"{', '.join(METRES)}.",
    ),
    point_std: float = option(
        CLICKED_STD,
        "PX",
        "Standard deviation of the given pixels, by default that of a click: most of the "
        "uncertainty of a length comes from it.",
    ),
    rectify: Path | None = option(None, "FILE", "Draw the plane from straight above, to scale."),
    resolution: float | None = option(
        None, "PX", "Pixels per unit of length in the view from above."
    ),
    rescale: bool = flag(
        "Scale the camera to the photograph, if only the resolution differs.", "--rescale"
    ),
    targets: str = option(
        "auto", "WHAT", "Targets to search for, as in calibrate.", offer=TAG_SEARCHES
    ),
    outline: Path | None = option(None, "FILE", "Outlines drawn by hand, as in calibrate."),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Measure lengths, angles and areas on the plane of a square.

    PHOTO is the one that the camera was calibrated with, or any other that it has taken, in which
    one square is enough: lay it beside the thing, on the same plane. The square is found in the
    photograph again, before the camera that is given.

    The standard deviations hold what is uncertain about the pixels, the plane's pose and the
    camera. Where the sides of the plane are bent, points are taken to lie off as far; what paper is
    bent by beyond its sides is not in them.
    """
    if camera is None:
        raise ValueError("say which camera took the photograph: --camera camera.json")
    pixels = _pixels(points or [])
    _check_request(len(pixels), rectify, resolution)
    given_side = None if side is None else Length.with_unit(side, "--side")
    check_outputs([photo, camera, outline], [rectify])
    calibration = read_camera(camera)
    picture, tag = read_photograph(photo)
    if rectify is not None:
        check_depth(picture, rectify)
    size = picture_size(picture)
    known = of_size(calibration, size, rescale, str(photo))
    warnings = [] if tag is None else [_orientation_warning(photo, tag, size)]
    _check_inside(pixels, size, warnings)
    lens = camera_of(known)
    with progress_bar("measuring", quiet), reading():
        found = located(picture, known, targets=targets, outlines=outline)
    index, *alternatives = _likely_planes(pixels, found.planes, lens) if plane is None else (plane,)
    chosen = _chosen(found.planes, index)
    # The calibration states the side of frames, not of holes.
    stated_side = None if index in found.holes else _stated_side(calibration)
    length = given_side or stated_side or Length(1.0, "")
    warnings += _side_warnings(given_side, stated_side)
    warnings += _plane_warnings(found, index, alternatives, calibration)
    lines = [_heading(index, chosen, given_side, stated_side)]
    members = _plane_members(index, chosen, length)
    if len(pixels):
        measured = measure(chosen, pixels, known, side=length.value, point_std=point_std)
        exact = measure(chosen, pixels, known, side=length.value, point_std=0.0)
        lines += _lines(measured, length)
        lines += _share_of_points(measured, exact, point_std)
        lines += _side_errors(chosen)
        members |= {key: value for key, value in measured.members().items() if key not in members}
        warnings += _doubts(measured, pixels, found.planes, index)
    if rectify is not None:
        scale = None if resolution is None else resolution * length.value
        view = rectified(picture, chosen, lens, resolution=scale)
        write_atomically({rectify: encode_image(view.image, rectify)})
        lines += [_view_line(view, length), f"wrote {rectify}"]
        members["rectified"] = _view_members(view, length)
        warnings += _doubts_of_view(view, length, rectify)
    answer(json, quiet, members | texts_and_codes(warnings), lines, coded_lines(warnings))


def _check_request(points: int, rectify: Path | None, resolution: float | None) -> None:
    """Check that there are points to measure between, or a view to draw."""
    if points == 1 or (not points and rectify is None):
        raise ValueError("give two points or more, as X,Y; or --rectify FILE")
    if resolution is not None and rectify is None:
        raise ValueError("--resolution is of the view from above: give --rectify FILE as well")


def _orientation_warning(
    photo: Path, tag: OrientationTag, size: tuple[int, int]
) -> CalibrationWarning:
    text = f"{photo}: {tag.ignored('the points refer', size)}"
    return CalibrationWarning(text, "orientation_ignored")


def _check_inside(
    pixels: FloatArray, size: tuple[int, int], warnings: Sequence[CalibrationWarning]
) -> None:
    """Refuse points outside the picture; the error includes warnings, which may explain it."""
    try:
        check_inside(pixels, size)
    except ValueError as error:
        raise ValueError("; ".join([str(error), *warnings])) from error


def _plane_members(index: int, plane: Plane, length: Length) -> dict[str, Any]:
    return {
        "format": MEASUREMENT_FORMAT,
        "plane": index,
        "kind": plane.kind,
        "corners": plane.corners.tolist(),
        "side": length.value,
        "unit": length.unit,
    }


def _heading(index: int, plane: Plane, given: Length | None, stated: Length | None) -> str:
    """Return a heading with the plane, and with the side if it comes from the calibration."""
    x, y = plane.corners.mean(axis=0)
    heading = f"on plane {index}, a {plane.kind} around ({x:.0f}, {y:.0f})"
    if given is not None:
        return heading
    if stated is None:
        return f"{heading} (in sides; say --side)"
    return f"{heading}, side {stated.value:g} {stated.unit} as calibrated"


def _side_warnings(given: Length | None, stated: Length | None) -> Iterator[CalibrationWarning]:
    if given is not None and stated is not None and not isclose(given.metres, stated.metres):
        text = (
            f"--side {given.value:g} {given.unit} is used, where the calibration states "
            f"{stated.value:g} {stated.unit}: right if this is another square"
        )
        yield CalibrationWarning(text, "side_differs")


def _plane_warnings(
    found: Located, index: int, alternatives: Sequence[int], calibration: Calibration | Camera
) -> Iterator[CalibrationWarning]:
    """Yield warnings of a plane that may not be what it is taken for, or not the one meant."""
    if index in found.holes:
        yield CalibrationWarning(f"plane {index} {HOLE}", "side_unknown")
    kind = found.planes[index].kind
    if kind != RECTANGLE and _are_rectangles(calibration):
        text = (
            f"plane {index} is taken for a {kind}, where the calibration's planes are "
            "rectangles: if it is one of them, name it as there, such as --targets a4"
        )
        yield CalibrationWarning(text, "shape_differs")
    if alternatives:
        options = " or ".join(f"--plane {number}" for number in (index, *alternatives))
        text = (
            f"a point lies on no plane: plane {index} is the nearest, and plane "
            f"{listed([str(alternative) for alternative in alternatives])} nearly as near: "
            f"say {options}"
        )
        yield CalibrationWarning(text, "plane_unclear")
    if found.doubts[index] is not None:
        yield CalibrationWarning(f"plane {index}: {found.doubts[index]}", "plane_misfits")


def _side_errors(plane: Plane) -> Iterator[str]:
    if plane.uncertainty is not None and plane.uncertainty.side_error is not None:
        yield (
            f"the sides of the {plane.kind} have a common error (is it bent?) of "
            f"{plane.uncertainty.side_error:.2g} px rms: points are taken to lie off as far"
        )


def _view_members(view: TopView, length: Length) -> dict[str, Any]:
    """Return the member ``rectified``, in the unit of length."""
    return {
        "image_size": list(view.image.shape[1::-1]),
        "origin": [length.value * value for value in view.origin],
        "resolution": view.resolution / length.value,
    }


def _view_line(view: TopView, length: Length) -> str:
    unit = length.unit or ("side" if length.value == 1 else "unit")
    return f"from above: {view.resolution / length.value:.6g} px to a {unit}"


def _doubts_of_view(view: TopView, length: Length, path: Path) -> Iterator[CalibrationWarning]:
    width, height = view.image.shape[1::-1]
    if max(width, height) < MIN_SHOWN:
        per = length.unit or "side of the square, as no side is known (--side)"
        text = f"{path}: is {width} x {height} pixels only: --resolution is in pixels per {per}"
        yield CalibrationWarning(text, "small_view")


def _pixels(points: Sequence[str]) -> FloatArray:
    pixels = []
    for text in points:
        try:
            x, y = (float(part) for part in text.split(","))
        except ValueError as error:
            raise ValueError(
                f"a point is written X,Y, as 150,120 with no space, not {text!r}"
            ) from error
        pixels.append((x, y))
    return np.array(pixels).reshape(-1, 2)


def _stated_side(known: Calibration | Camera) -> Length | None:
    """Return the side that the calibration states, which is the same for all planes."""
    sides = [plane.side for plane in known.planes] if isinstance(known, Calibration) else []
    stated = next((side for side in sides if side is not None), None)
    return None if stated is None else Length.of_metres(stated)


def _are_rectangles(known: Calibration | Camera) -> bool:
    """Return whether a camera was calibrated only from rectangles."""
    kinds = {plane.kind for plane in known.planes} if isinstance(known, Calibration) else set()
    return kinds == {RECTANGLE}


def _likely_planes(pixels: FloatArray, planes: Sequence[Plane], camera: Camera) -> tuple[int, ...]:
    """Return the plane around most pixels, if there are several the nearest, and alternatives.

    Alternatives are planes nearly as near, if no plane is around a pixel.
    """
    if not len(pixels):
        return (0,)
    point_counts = [_count_within(pixels, plane) for plane in planes]
    if len(pixels) in point_counts:
        return (point_counts.index(len(pixels)),)
    distances = [extrapolation_on(plane, pixels, camera) for plane in planes]
    first, *alternatives = sorted(
        range(len(planes)), key=lambda index: (-point_counts[index], distances[index])
    )
    if point_counts[first] or distances[first] == inf:
        return (first,)
    return first, *(
        alternative
        for alternative in alternatives
        if distances[alternative] <= NEARLY_AS_NEAR * distances[first]
    )


def _count_within(pixels: FloatArray, plane: Plane) -> int:
    return sum(not separated(plane.corners, pixel[None]) for pixel in pixels)


def _chosen(planes: Sequence[Plane], index: int) -> Plane:
    if not 0 <= index < len(planes):
        shown = "; ".join(
            "{}: a {} around ({:.0f}, {:.0f})".format(i, p.kind, *p.corners.mean(axis=0))
            for i, p in enumerate(planes)
        )
        raise ValueError(f"there is no plane {index} in the photograph, but {shown}")
    return planes[index]


def _doubts(
    measured: Measurement, pixels: FloatArray, planes: Sequence[Plane], index: int
) -> Iterator[CalibrationWarning]:
    """Yield warnings of points that may not be on the plane that they are measured on."""
    for number, (x, y) in enumerate(pixels, 1):
        planes_around = [
            plane_index
            for plane_index, plane in enumerate(planes)
            if not separated(plane.corners, np.array([[x, y]]))
        ]
        if planes_around and index not in planes_around:
            surrounding = planes_around[0]
            text = (
                f"point {number}, ({x:g}, {y:g}), is within plane {surrounding}: it is measured as "
                f"if it were on plane {index}; say --plane {surrounding} if it is not"
            )
            yield CalibrationWarning(text, "point_on_other_plane")
    if measured.extrapolation is not None and measured.extrapolation > FAR:
        text = (
            f"extrapolation: the farthest point is {measured.extrapolation:.1f} times as far from "
            f"the middle of the {planes[index].kind} as its corners; the lengths are right if the "
            "plane is flat up to there and the point is on it"
        )
        yield CalibrationWarning(text, "lengths_extrapolated")


def _lines(measured: Measurement, length: Length) -> Iterator[str]:
    for i, (value, std) in enumerate(zip(measured.lengths, measured.lengths_std, strict=True)):
        yield f"length {i + 1} to {i + 2}: {length.after(plus_minus(value, std))}"
    for i, (value, std) in enumerate(zip(measured.angles, measured.angles_std, strict=True)):
        yield f"angle at {i + 2}: {plus_minus(value, std)} degrees"
    if measured.area is not None and measured.area_std is not None:
        yield f"area: {length.after(plus_minus(measured.area, measured.area_std), '^2')}"
    elif len(measured.points) > 2:
        yield "area: none, for the polygon's sides cross: give its corners in order round it"


def _share_of_points(measured: Measurement, exact: Measurement, point_std: float) -> Iterator[str]:
    """Yield a line with the fraction of the lengths' variance that is due to the given pixels."""
    if point_std > 0.0:
        share = 1.0 - float(np.sum(exact.lengths_std**2) / np.sum(measured.lengths_std**2))
        yield (
            f"the points, taken as known to {point_std:g} px (--point-std), make up "
            f"{100 * share:.0f} % of the variance of the lengths"
        )
