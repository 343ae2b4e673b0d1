"""What a report says: the numbers of a calibration as rows and sentences."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trisquare._core import __version__
from trisquare._support.arrays import FloatArray
from trisquare._support.number_text import decimals_shown
from trisquare._support.rotations import tilt_degrees
from trisquare.analysis.comparison import two_digits
from trisquare.analysis.diagnosis import diagnose
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.camera.projection_uncertainty import ProjectionMap
from trisquare.report.pictures import ReportedPicture
from trisquare.report.plot_style import SERIES
from trisquare.results.calibration import Calibration

MEANINGS = {
    "fx": "focal length along x, px",
    "fy": "focal length along y, px",
    "cx": "principal point, x, px",
    "cy": "principal point, y, px",
    "k1": "radial distortion, of r\N{SUPERSCRIPT TWO}",
    "k2": "radial distortion, of r\N{SUPERSCRIPT FOUR}",
    "k3": "radial distortion, of r\N{SUPERSCRIPT SIX}",
    "p1": "tangential distortion, first",
    "p2": "tangential distortion, second",
}

MOST_REJECTED = 30
"""Rows on candidates that were not used."""


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A parameter: text as it is printed; `limits` and `remedy` are empty if it was held."""

    name: str
    meaning: str
    value: str
    std: str
    limits: str = ""
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class PlaneRow:
    """A plane, as it is printed."""

    number: int
    colour: int
    kind: str
    picture: str
    distance: str
    tilt: str
    rms: str
    samples: int


@dataclass(frozen=True, slots=True)
class RejectedRow:
    """A candidate that was not used, as it is printed."""

    kind: str
    picture: str
    place: str
    reason: str
    residual: str


def parameter_rows(calibration: Calibration) -> list[ParameterRow]:
    """Return the free parameters, and the held ones that matter."""
    rows = []
    diagnosis = diagnose(calibration)
    for name, value in camera_parameters(calibration.camera).items():
        if name in calibration.std:
            std = calibration.std[name]
            decimals = decimals_shown(std)
            found = diagnosis.get(name)
            limits, remedy = ("", "") if found is None else (found.limits, found.remedy)
            texts = f"{value:.{decimals}f}", f"{std:.{decimals}f}"
            rows.append(ParameterRow(name, MEANINGS[name], *texts, limits, remedy))
        elif value != 0 or name in ("fx", "fy", "cx", "cy"):
            rows.append(ParameterRow(name, MEANINGS[name], f"{value:.6g}", "held"))
    return rows


def correlations(calibration: Calibration) -> list[list[float]]:
    """Return the correlation matrix of the free parameters; zero where one has no spread."""
    spread = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    scale = np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > 0.0)
    matrix: FloatArray = np.clip(calibration.covariance * np.outer(scale, scale), -1.0, 1.0)
    rows: list[list[float]] = matrix.tolist()
    return rows


def plane_rows(calibration: Calibration, names: Sequence[str]) -> list[PlaneRow]:
    """Return the planes; `names` are the pictures'."""
    rows = []
    for number, plane in enumerate(calibration.planes):
        tilt = tilt_degrees(plane.rotation)
        rows.append(
            PlaneRow(
                number=number,
                colour=number % SERIES,
                kind=plane.kind,
                picture=_name(names, plane.image),
                distance=f"{np.linalg.norm(plane.translation):.3f}",
                tilt=f"{tilt:.1f}\N{DEGREE SIGN}",
                rms=f"{plane.rms:.4f}",
                samples=plane.samples,
            )
        )
    return rows


def rejected_rows(calibration: Calibration, names: Sequence[str]) -> list[RejectedRow]:
    """Return the first of the candidates that were not used."""
    rows = []
    for candidate in calibration.rejected[:MOST_REJECTED]:
        x, y = candidate.corners.mean(axis=0).tolist()
        residual = "" if candidate.residual is None else f"{candidate.residual:.3g} px"
        place = f"({x:.0f}, {y:.0f})"
        picture = _name(names, candidate.image)
        rows.append(RejectedRow(candidate.kind, picture, place, candidate.reason, residual))
    return rows


def summary(calibration: Calibration, known: ProjectionMap) -> Iterator[str]:
    """Say in sentences what came out."""
    camera = calibration.camera
    width, height = camera.image_size
    angles = _field_of_view(camera)
    view = "" if angles is None else f", which see {angles[0]:.1f} by {angles[1]:.1f} degrees"
    pictures = len({plane.image for plane in calibration.planes})
    yield (
        f"A camera with pictures of {width} \N{MULTIPLICATION SIGN} {height} pixels{view}, "
        f"calibrated from {_count(len(calibration.planes), 'plane')} in "
        f"{_count(pictures, 'photograph')}."
    )
    finite = known.std[np.isfinite(known.std)]
    if len(finite) > 0 and finite.max() > 0.0:
        places = (finite.min(), float(np.median(finite)), finite.max())
        best, median, worst = (two_digits(place) for place in places)
        yield (
            f"Projected points are known to {best} px at the best place of the picture, to "
            f"{median} px at the median place and to {worst} px at the worst (one standard "
            "deviation)."
        )
    beyond = 1.0 - len(finite) / known.std.size
    if beyond > 0.0:
        yield (
            f"The lens model does not cover {100.0 * beyond:.0f} % of the picture: nothing "
            "is known there."
        )
    yield (
        f"The reprojection error of the measured edges is {two_digits(calibration.rms)} "
        f"px (rms), {calibration.noise_scale:.2f} times what their noise predicts."
    )


def settings(calibration: Calibration) -> list[tuple[str, str]]:
    """Return what was asked for, and what it was computed with."""
    methods = {"ml": "maximum likelihood (ml)", "linear": "the three linear steps (linear)"}
    method = methods.get(calibration.method, calibration.method)
    rows = [("method", f"{method}; the numbers are from the {calibration.stage} stage")]
    others = ", ".join(f"{o.model} {o.log_evidence:.1f}" for o in calibration.alternatives)
    chosen = f", by evidence (log odds of the others: {others})" if others else ""
    rows.append(("lens model", calibration.camera.model + chosen))
    rows.append(("held", ", ".join(calibration.fixed) or "nothing"))
    rows.append(("tone curve", _tone(calibration)))
    rows.append(("calibrated by", f"trisquare {calibration.software}"))
    rows.append(
        (
            "reported by",
            f"trisquare {__version__}, Python {platform.python_version()}, "
            f"NumPy {np.__version__}, OpenCV {cv2.__version__}, "
            f"{platform.system()} {platform.machine()}",
        )
    )
    return rows


def picture_rows(pictures: Sequence[ReportedPicture]) -> list[tuple[str, str]]:
    """Return the pictures' names and what tells their files from others."""
    return [
        (picture.name, "no file" if picture.digest is None else f"SHA-256 {picture.digest}\u2026")
        for picture in pictures
    ]


def _tone(calibration: Calibration) -> str:
    tone = calibration.tone
    if tone is None:
        return "none: there were no pixels"
    if isinstance(tone, str):
        return tone
    estimated = calibration.tone_std is not None
    return f"gamma {tone:.3f}" + (
        f", estimated, std {calibration.tone_std:.3f}" if estimated else ""
    )


def _field_of_view(camera: Camera) -> tuple[float, float] | None:
    """Return the angles across and down through the middle; None where the lens does not reach."""
    width, height = camera.image_size
    middle = [(width - 1) / 2.0, (height - 1) / 2.0]
    ends = [
        [-0.5, middle[1]],
        [width - 0.5, middle[1]],
        [middle[0], -0.5],
        [middle[0], height - 0.5],
    ]
    try:
        left, right, top, bottom = camera.unproject(ends)
    except ValueError:
        return None
    across, down = (float(np.clip(a @ b, -1.0, 1.0)) for a, b in ((left, right), (top, bottom)))
    return float(np.degrees(np.arccos(across))), float(np.degrees(np.arccos(down)))


def _name(names: Sequence[str], index: int) -> str:
    return names[index] if index < len(names) else f"picture {index}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")
