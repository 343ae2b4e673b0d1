"""Content of a report: the numbers of a calibration as rows and sentences."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterable, Iterator
from itertools import combinations

import cv2
import numpy as np

from trisquare._core import __version__
from trisquare._support.number_text import with_its_std
from trisquare._support.rotations import tilt_degrees
from trisquare.analysis.comparison import two_digits
from trisquare.analysis.plane_angle import plane_angle
from trisquare.camera.angles_of_view import angles_of_view
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.camera.lens_models import COEFFICIENTS, is_fisheye
from trisquare.camera.projection_uncertainty import ProjectionMap, known_part
from trisquare.images.exif import StatedFocalLength
from trisquare.results.calibration import Calibration
from trisquare.results.model_alternative import evidence_text
from trisquare.results.plane import Plane

_INTRINSICS = {
    "fx": "focal length along x",
    "fy": "focal length along y",
    "cx": "principal point, x",
    "cy": "principal point, y",
    "skew": "skew",
}
_OF_POWERS = ("of r\N{SUPERSCRIPT TWO}", "of r\N{SUPERSCRIPT FOUR}", "of r\N{SUPERSCRIPT SIX}")
_OF_FISHEYE = {
    f"k{i}": f"radial distortion, of \N{GREEK SMALL LETTER THETA}{power}"
    for i, power in enumerate(
        (
            "\N{SUPERSCRIPT TWO}",
            "\N{SUPERSCRIPT FOUR}",
            "\N{SUPERSCRIPT SIX}",
            "\N{SUPERSCRIPT EIGHT}",
        ),
        1,
    )
}
_OF_PINHOLE = {
    **{f"k{i}": f"radial distortion, {of}" for i, of in enumerate(_OF_POWERS, 1)},
    **{f"k{i}": f"radial distortion's denominator, {of}" for i, of in enumerate(_OF_POWERS, 4)},
    "p1": "tangential distortion, first",
    "p2": "tangential distortion, second",
    "s1": f"thin prism along x, {_OF_POWERS[0]}",
    "s2": f"thin prism along x, {_OF_POWERS[1]}",
    "s3": f"thin prism along y, {_OF_POWERS[0]}",
    "s4": f"thin prism along y, {_OF_POWERS[1]}",
}


MAX_ANGLED = 4
"""Maximum number of planes whose angles are listed: six pairs."""


def meanings(camera: Camera) -> dict[str, str]:
    """Return the meanings of the parameters of a camera, by name."""
    return _INTRINSICS | (_OF_FISHEYE if is_fisheye(camera.model) else _OF_PINHOLE)


def unit_of(name: str) -> str:
    """Return the unit of a parameter; coefficients of distortion have no unit."""
    return "px" if name in _INTRINSICS else ""


def parameter_texts(calibration: Calibration) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, unit, value and std of all free parameters and of the relevant fixed ones."""
    for name, value in camera_parameters(calibration.camera).items():
        if name in calibration.std:
            yield name, unit_of(name), *with_its_std(value, calibration.std[name])
        elif value != 0 or name in ("fx", "fy", "cx", "cy"):
            yield name, unit_of(name), f"{value:.6g}", "fixed"


def focal_length_text(calibration: Calibration, stated: StatedFocalLength) -> str:
    """Return a sentence on the focal length in millimetres, and on that of the Exif block."""
    camera, scales = calibration.camera, stated.pixels_per_millimetre
    length = float(np.mean(np.divide((camera.fx, camera.fy), scales)))
    std = calibration.std.get("fx", 0.0) / scales[0]
    if stated.is_nominal:
        length_text = f"about {length:.3g} mm"
        known_by = "the equivalent for 35-mm film that it states, which is rounded"
    else:
        value, std_text = with_its_std(length, std) if std else (f"{length:.4g}", "0")
        length_text = f"{value} mm (std {std_text})"
        known_by = "the resolution in the focal plane that it states"
    return (
        f"In millimetres the focal length is {length_text}; Exif states {stated.millimetres:.4g} "
        f"mm. The size of a pixel is known by {known_by}."
    )


def distance_unit(planes: Iterable[Plane]) -> str:
    """Return the unit of the distances of planes: metres if any plane has a side."""
    return "sides" if all(plane.side is None for plane in planes) else "m"


def plane_texts(plane: Plane, unit: str) -> tuple[str, str, str, str]:
    """Return a plane's distance, tilt in degrees, rms and samples.

    The distance is in the unit of `distance_unit`, or is followed by its own unit.
    """
    plane_unit = "sides" if plane.side is None else "m"
    distance = f"{np.linalg.norm(plane.tvec):.3f}"
    return (
        distance if plane_unit == unit else f"{distance} {plane_unit}",
        f"{tilt_degrees(plane.rotation):.1f}",
        f"{plane.rms:.4f}",
        str(plane.samples),
    )


def angles_between_planes(calibration: Calibration) -> str:
    """Return a sentence on the angles between planes of one picture; empty for many planes."""
    planes = [
        (number, plane)
        for number, plane in enumerate(calibration.planes)
        if plane.is_used and plane.uncertainty is not None
    ]
    if len(planes) > MAX_ANGLED or len({plane.image for _, plane in planes}) != 1:
        return ""
    angles = [
        f"{first} and {second}: {plane_angle(first_plane, second_plane, calibration)}"
        for (first, first_plane), (second, second_plane) in combinations(planes, 2)
    ]
    return f"Angles between the planes {', '.join(angles)}." if angles else ""


def summary(calibration: Calibration, known: ProjectionMap) -> Iterator[str]:
    """Yield sentences that summarise the result."""
    camera = calibration.camera
    width, height = camera.image_size
    angles = angles_of_view(camera)
    view = "" if angles is None else f", which see {angles[0]:.1f} by {angles[1]:.1f} degrees"
    used = [plane for plane in calibration.planes if plane.is_used]
    pictures = len({plane.image for plane in used})
    yield (
        f"A camera with pictures of {width} \N{MULTIPLICATION SIGN} {height} pixels{view}, "
        f"calibrated from {_count(len(used), 'plane')} in "
        f"{_count(pictures, 'photograph')}."
    )
    finite = known.std[np.isfinite(known.std)]
    if len(finite) > 0 and finite.max() > 0.0:
        places = (finite.min(), float(np.median(finite)), finite.max())
        best, median, worst = (two_digits(place) for place in places)
        yield (
            f"Projected points are known to {best} px at the best place of the picture, to "
            f"{median} px at the median place and to {worst} px at the worst (one standard "
            "deviation, up to a rotation of the whole camera)."
        )
    uncovered_share = 1.0 - known_part(camera)
    if uncovered_share > 0.0:
        yield (
            f"The lens model does not cover {100.0 * uncovered_share:.0f} % of the picture: "
            "nothing is known there."
        )
    yield (
        f"The residuals of the edge samples are {two_digits(calibration.rms)} px (rms), "
        f"{calibration.noise_scale:.2f} times what their noise predicts."
    )


def copied(camera: Camera) -> str:
    """Return the camera matrix and the distortion as Python text, with all digits."""
    rows = ", ".join(str(row) for row in camera.K.tolist())
    name = "cv2.fisheye takes it" if is_fisheye(camera.model) else "cv2 takes it"
    return f"K = [{rows}]\ndistortion = {camera.distortion.tolist()}  # as {name}"


def settings(calibration: Calibration) -> list[tuple[str, str]]:
    """Return the settings of the calibration, and the software versions."""
    methods = {"ml": "maximum likelihood (ml)", "linear": "the three linear steps (linear)"}
    method = methods.get(calibration.method, calibration.method)
    evidence = evidence_text(calibration.alternatives)
    chosen = f", {evidence}" if evidence else ""
    reported_by = (
        f"trisquare {__version__}, Python {platform.python_version()}, "
        f"NumPy {np.__version__}, OpenCV {cv2.__version__}, "
        f"{platform.system()} {platform.machine()}"
    )
    return [
        ("method", f"{method}; the numbers are from the {calibration.stage} stage"),
        ("lens model", calibration.camera.model + chosen),
        ("fixed", held_text(calibration) or "nothing"),
        ("tone curve", _tone(calibration)),
        ("calibrated by", f"trisquare {calibration.software}"),
        ("reported by", reported_by),
        ("reported on", _today()),
    ]


def held_text(calibration: Calibration) -> str:
    """Return what is fixed, with its values, and relations of planes; empty if there is nothing."""
    camera = calibration.camera
    coefficients = zip(COEFFICIENTS[camera.model], camera.distortion, strict=True)
    bending = [f"{name} {value:.6g}" for name, value in coefficients if value != 0.0]
    texts = {
        "aspect": f"aspect at {camera.fy / camera.fx:.6g}",
        "principal_point": f"principal point at ({camera.cx:.6g}, {camera.cy:.6g})",
        "focal": f"focal length at fx {camera.fx:.6g}, fy {camera.fy:.6g}",
        "distortion": f"distortion at {', '.join(bending) or 'zero'}",
    }
    texts_held = [texts.get(name, name) for name in calibration.fixed]
    texts_held += [
        f"planes {first} and {second} orthogonal" for first, second in calibration.orthogonal
    ]
    texts_held += [
        f"planes {first} and {second} parallel" for first, second in calibration.parallel
    ]
    return "; ".join(texts_held)


def _today() -> str:
    """Return the date; reproducible builds set it."""
    stated = os.environ.get("SOURCE_DATE_EPOCH")
    now = time.time() if stated is None else float(stated)
    return time.strftime("%Y-%m-%d", time.gmtime(now))


def _tone(calibration: Calibration) -> str:
    tone = calibration.tone
    if tone is None:
        return "none: there were no pixels"
    if isinstance(tone, str):
        return tone
    std = calibration.tone_std
    return f"gamma {tone:.3f}" + ("" if std is None else f", estimated, std {std:.3f}")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
