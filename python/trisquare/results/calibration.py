"""The results of a calibration: frozen, checked, and exact through JSON and pickle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy.typing as npt

import trisquare._core as _core
from trisquare._core import __version__
from trisquare._support.arrays import (
    FloatArray,
    ReadOnlyDict,
    instances,
    not_negative,
    real_array,
    real_number,
    string,
    strings,
)
from trisquare._support.json_members import JsonFields, dump_members
from trisquare._support.number_text import with_its_std
from trisquare._support.paths import File, naming, read_text
from trisquare._support.records import (
    NUMBER,
    TEXT,
    TEXTS,
    Kind,
    Record,
    check_members,
    member,
    record,
    record_from_members,
    record_members,
    records,
)
from trisquare._support.suggestions import unknown
from trisquare._support.writing import write_text
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import OPENCV_NAMES, Camera, camera_parameters
from trisquare.camera.file_formats import registered_files
from trisquare.camera.members import camera_from_members, camera_members
from trisquare.camera.projection_uncertainty import (
    ProjectionMap,
    UncertainCamera,
    projection_covariance,
    projection_map,
    rms_displacement,
    uncertain,
)
from trisquare.camera.settings import FIXABLE, METHODS, PlanePair, checked_pairs
from trisquare.edges import PlaneEdges, edges_from_members, edges_members
from trisquare.errors import NotEnoughDataError
from trisquare.results.calibration_warning import WARNINGS, CalibrationWarning
from trisquare.results.model_alternative import ModelAlternative, evidence_text
from trisquare.results.plane import Plane
from trisquare.results.rejected import Rejected
from trisquare.results.residual_correlation import ResidualCorrelation
from trisquare.results.residuals import FigureResiduals
from trisquare.results.scene_line import SceneLine

__all__ = ["Calibration", "Camera", "Plane"]

RESULT_FORMAT = "trisquare/1"

STD_TOLERANCE = 1e-6
"""Relative difference between a standard deviation and the root of its variance, as by rounding in
another program."""

JSON_ORDER = (
    *("software", "method", "stage", "tone", "tone_std", "fixed", "orthogonal", "parallel"),
    *("image_size", "camera", "std", "parameters", "covariance", "rms_px", "noise_scale"),
    *("planes", "pictures", "warnings", "lines", "alternatives", "coherence", "rejected"),
)
"""Order of a result's JSON members; measured edges and their residuals, if requested, come last."""


def _checked_deviations(value: Any, name: str) -> Mapping[str, float]:
    return ReadOnlyDict(
        {
            string(parameter, f"{name}'s key"): not_negative(std, f"{name}[{parameter!r}]")
            for parameter, std in dict(value).items()
        }
    )


def _checked_method(value: Any, name: str) -> str:
    method = string(value, name)
    if method not in METHODS:
        raise unknown(name, method, METHODS)
    return method


def _checked_fixed(value: Any, name: str) -> tuple[str, ...]:
    names = strings(value, name)
    for fixed in names:
        if fixed not in FIXABLE:
            raise unknown(f"member of {name}", fixed, FIXABLE)
    return names


PAIRS = Kind(lambda value, name: checked_pairs(name, value), JsonFields.pairs)


def _checked_tone(value: Any, name: str) -> str | float | None:
    return value if value is None or isinstance(value, str) else real_number(value, name)


def _read_tone(members: JsonFields, key: str) -> str | float | None:
    tone = members.value(key)
    return tone if tone is None or isinstance(tone, str) else members.number(key)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration(Record):
    """A camera with its uncertainty, and the planes that it was calibrated from.

    Parameters
    ----------
    camera : Camera
        The estimated camera.
    std : mapping of str to float
        One standard deviation of each free parameter, by name; with a fixed aspect ratio,
        ``std["fy"]`` is ``std["fx"]`` times ``fy / fx``, although ``fy`` is not among
        `parameters`.
    covariance : array_like, shape (n, n)
        Covariance of the free parameters, in the order of `parameters`.
    parameters : sequence of str
        Names of the free parameters: of ``fx fy cx cy`` and the model's coefficients, these
        sorted by name: ``k1 k2 k3 p1 p2``; then ``skew`` if it was freed.
    planes : sequence of Plane
        The physical planes.
    rms : float
        Root mean square residual of all edge samples, in pixels.
    noise_scale : float
        The residuals' spread relative to the stated standard deviations; the covariance is
        scaled by its square.
    warnings : sequence of CalibrationWarning or str
        Problems to resolve before relying on the result, the most severe first. Each is its text,
        with a `code`, a `severity` and the `plane` it is about.
    method : str
        ``"ml"`` or ``"linear"``.
    tone : str, float or None
        Tone curve of the pixels; None if there were no pixels. An estimated curve is given as the
        pure gamma that maps mid-grey (18 % of white) to the same value.
    fixed : sequence of str
        What was fixed: any of ``aspect``, ``principal_point``, ``focal``, ``distortion``.
    stage : str
        The stage of the pipeline that produced the result.
    software : str
        Version of trisquare that computed the result.
    alternatives : sequence of ModelAlternative
        The models that ``model="auto"`` rejected, the simplest first; empty with a named model.
    coherence : ResidualCorrelation, optional
        Correlation of the residuals, which the covariance allows for; None in results of versions
        that did not estimate it.
    rejected : sequence of Rejected
        What was found in the pictures but not used, with the reason.
    tone_std : float, optional
        One standard deviation of an estimated gamma; None if the tone curve was stated.
    edges : sequence of PlaneEdges
        Edges that it was calibrated from; empty in results that were read from JSON without them.
    residuals : sequence of FigureResiduals
        Distances of the samples of `edges` from the calibrated model, in the order of `edges`;
        empty if `edges` are.
    lines : sequence of SceneLine
        The lines of the scene that were given or found, used or rejected; `edges` are without them.
    pictures : sequence of str
        Names of the photographs' files, without their folders, by the index `image` of planes,
        lines and `rejected`; ``"frame 7 of clip.mp4"`` for a frame of a video, empty for what is
        not a file. Without members for a single photograph, and if none is a file.
    orthogonal, parallel : sequence of (int, int)
        The pairs of `planes` that were constrained to be at a right angle, or parallel.

    Examples
    --------
    >>> K, distortion = result.camera.K, result.camera.distortion
    >>> print(f"fx is known to {result.std['fx']:.3f} px, from {len(result.planes)} planes")
    fx is known to 0.077 px, from 3 planes
    """

    # No annotation, which would add it to `__dataclass_fields__`.
    other_names = MappingProxyType(
        {
            name: f"camera.{name}"
            for name in (
                *("K", "fx", "fy", "cx", "cy", "skew", "distortion", "model", "image_size"),
                *("project", "unproject", "distort_points", "undistort_points", "undistorted"),
            )
        }
        | {name: f"camera.{own}" for name, own in OPENCV_NAMES.items()}
        | {"rvecs": "planes[0].rvec", "tvecs": "planes[0].tvec"}
    )

    camera: Camera
    std: Mapping[str, float] = field(
        metadata=member(Kind(_checked_deviations, JsonFields.numbers_by_name))
    )
    covariance: FloatArray
    parameters: tuple[str, ...] = field(metadata=member(TEXTS))
    planes: tuple[Plane, ...] = field(metadata=member(records(Plane)))
    rms: float = field(metadata=member(NUMBER, "rms_px"))
    noise_scale: float = field(metadata=member(NUMBER))
    warnings: tuple[CalibrationWarning, ...] = field(metadata=member(WARNINGS))
    method: str = field(metadata=member(Kind(_checked_method, JsonFields.text)))
    tone: str | float | None = field(metadata=member(Kind(_checked_tone, _read_tone)))
    fixed: tuple[str, ...] = field(metadata=member(Kind(_checked_fixed, JsonFields.texts)))
    stage: str = field(metadata=member(TEXT))
    software: str = field(default=__version__, metadata=member(TEXT))
    alternatives: tuple[ModelAlternative, ...] = field(
        default=(), metadata=member(records(ModelAlternative))
    )
    tone_std: float | None = field(default=None, metadata=member(NUMBER))
    coherence: ResidualCorrelation | None = field(
        default=None, metadata=member(record(ResidualCorrelation))
    )
    rejected: tuple[Rejected, ...] = field(default=(), metadata=member(records(Rejected)))
    edges: tuple[PlaneEdges, ...] = ()
    residuals: tuple[FigureResiduals, ...] = field(
        default=(), metadata=member(records(FigureResiduals))
    )
    lines: tuple[SceneLine, ...] = field(default=(), metadata=member(records(SceneLine)))
    pictures: tuple[str, ...] = field(default=(), metadata=member(TEXTS))
    orthogonal: tuple[PlanePair, ...] = field(default=(), metadata=member(PAIRS))
    parallel: tuple[PlanePair, ...] = field(default=(), metadata=member(PAIRS))

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise TypeError(f"camera must be a Camera, not {type(self.camera).__name__}")
        check_members(self)
        size = len(self.parameters)
        covariance = real_array(self.covariance, "covariance", (size, size))
        object.__setattr__(self, "covariance", covariance)
        if (covariance.diagonal() < 0.0).any():
            raise ValueError("covariance contains a negative variance")
        twice = [name for name in self.parameters if self.parameters.count(name) > 1]
        if twice:
            raise ValueError(f"parameters has {twice[0]} twice")
        missing = [name for name in self.parameters if name not in self.std]
        if missing:
            raise ValueError(f"std lacks the free parameters {', '.join(missing)}")
        object.__setattr__(self, "edges", instances(self.edges, PlaneEdges, "edges"))
        related = [plane for pair in (*self.orthogonal, *self.parallel) for plane in pair]
        if related and max(related) >= len(self.planes):
            raise ValueError(
                f"plane {max(related)} is related, but there are only {len(self.planes)} planes"
            )
        samples = [[len(points) for points in figure.points] for figure in self.edges]
        if samples != [
            [len(residuals) for residuals in figure.distances] for figure in self.residuals
        ]:
            raise ValueError("residuals must be those of the edges: one for each sample")
        if any(residuals.plane >= len(self.planes) for residuals in self.residuals):
            raise ValueError(f"residuals must be of one of the {len(self.planes)} planes")

    def __eq__(self, other: object) -> bool:
        """Compare everything but measured edges, residuals and names of files."""
        if not isinstance(other, Calibration):
            return NotImplemented
        return self._stated() == other._stated()

    def __hash__(self) -> int:
        return hash(self._stated())

    def _stated(self) -> str:
        """Return the text by which two results are compared."""
        return replace(self, pictures=()).to_json()

    def __repr__(self) -> str:
        width, height = self.camera.image_size
        lines = [
            f"Calibration of a {width} x {height} camera "
            f"({self.camera.model}, {self.method}, from the {self.stage} stage)"
        ]
        for name, value in camera_parameters(self.camera).items():
            if name in self.std:
                text, std_text = with_its_std(value, self.std[name])
                lines.append(f"  {name}  {text:>12}  std {std_text}")
            elif value != 0:
                lines.append(f"  {name}  {value:12.6g}  fixed")
        for relation in ("orthogonal", "parallel"):
            if pairs := getattr(self, relation):
                pairs_text = "; ".join(f"{first} and {second}" for first, second in pairs)
                lines.append(f"  planes fixed as {relation}: {pairs_text}")
        lines.append(
            f"  rms {self.rms:.3g} px over {sum(plane.is_used for plane in self.planes)} planes, "
            f"noise scale {self.noise_scale:.2f}"
        )
        if self.alternatives:
            lines.append(f"  model {self.camera.model} {evidence_text(self.alternatives)}")
        if self.lines:
            used = sum(line.is_used for line in self.lines)
            lines.append(f"  {used} of {len(self.lines)} lines of the scene used")
        lines.extend(
            f"  warning ({warning.severity}): {warning} [{warning.code}]"
            for warning in self.warnings
        )
        return "\n".join(lines)

    def projection_covariance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the covariances of the projections of the directions seen at pixels.

        This is the uncertainty that matters to users of the camera: that of the pixel at which a
        viewing direction, fixed in the camera's frame, is seen. The parameters' own uncertainties
        may cancel or add up in it.

        Parameters
        ----------
        points : array_like, shape (N, 2)
            Pixels, within the valid radius; they may lie outside the picture.

        Returns
        -------
        ndarray, shape (N, 2, 2)
            Square pixels.

        Raises
        ------
        ValueError
            If a point lies beyond the valid radius.

        Examples
        --------
        >>> result.projection_covariance([[100, 80], [640, 480]]).shape
        (2, 2, 2)
        """
        return projection_covariance(self._uncertain, points)

    def projection_std(self, points: npt.ArrayLike) -> FloatArray:
        """Return the standard deviations of the projections of the directions seen at pixels.

        Parameters
        ----------
        points : array_like, shape (N, 2)
            As in `projection_covariance`.

        Returns
        -------
        ndarray, shape (N,)
            The rms displacement, pixels: the square root of the covariance's trace.

        Raises
        ------
        ValueError
            If a point lies beyond the valid radius.

        Examples
        --------
        >>> corner, middle = result.projection_std([[0, 0], [640, 480]])
        >>> bool(corner > middle)
        True
        """
        return rms_displacement(self.projection_covariance(points))

    def projection_map(
        self, step: float | None = None, *, rotation: str = "fitted"
    ) -> ProjectionMap:
        """Return the standard deviations of projections on a grid, border to border.

        Parameters
        ----------
        step : float, optional
            Maximum distance of the grid's lines, pixels; by default a 32nd of the width.
        rotation : {"fitted", "held"}
            A principal point with an error of a few pixels is nearly equivalent to a small rotation
            of the camera, which has no effect if the camera's pose is estimated with it, or does
            not matter. ``"fitted"``: the rotation that fits the whole picture best is removed, as
            in `compare`. ``"held"``: directions are fixed in the camera's frame, as in
            `projection_std`.

        Returns
        -------
        ProjectionMap
            ``x``, ``y`` and ``std[row, column]``, infinite beyond the valid radius.

        Examples
        --------
        >>> uncertainty = result.projection_map(step=100)
        >>> uncertainty.std.shape == (len(uncertainty.y), len(uncertainty.x))
        True
        """
        return projection_map(self.camera, self._uncertain, step, rotation)

    @property
    def _uncertain(self) -> UncertainCamera:
        return uncertain(self.camera, self.parameters, self.fixed, self.covariance)

    def to_json(self, *, edges: bool = False) -> str:
        """Return the result as JSON text that `from_json` reads back exactly.

        Parameters
        ----------
        edges : bool
            Whether to include the measured edges and their residuals, the largest part by far.

        Examples
        --------
        >>> import json
        >>> json.loads(result.to_json())["camera"]["model"]
        'radial2'
        """
        return dump_members(self.members(edges=edges))

    def members(self, *, edges: bool = False) -> dict[str, Any]:
        """Return the result as a JSON object, whose text `to_json` returns.

        Parameters
        ----------
        edges : bool
            As in `to_json`.

        Examples
        --------
        >>> result.members()["camera"]["model"]
        'radial2'
        """
        members = {
            **record_members(self),
            "format": RESULT_FORMAT,
            "image_size": list(self.camera.image_size),
            "camera": camera_members(self.camera),
            "covariance": self.covariance.tolist(),
        }
        shown = {key: members[key] for key in ("format", *JSON_ORDER) if key in members}
        if edges:
            shown["edges"] = [edges_members(figure) for figure in self.edges]
            shown["residuals"] = members.get("residuals", [])
        return shown

    def save(
        self, path: File, format: str | None = None, *, approximate: bool = False
    ) -> Approximation | None:
        """Write the result as JSON, or its camera in the format of another program.

        Parameters
        ----------
        path : str, path or open file
            The file; a named file is written completely or left untouched.
        format : str, optional
            As in `Camera.save`; by default by the file's name. Only trisquare's own format,
            ``.json``, has the uncertainties and planes.
        approximate : bool
            As in `Camera.save`.

        Returns
        -------
        Approximation or None
            As `Camera.save`.

        Raises
        ------
        LensModelError, ValueError, OSError
            As `Camera.save`.

        Examples
        --------
        >>> result.save("camera.json")  # all of it
        >>> result.save("camera.yaml")  # the camera alone, as OpenCV has it
        """
        if registered_files().is_own(path, format):
            write_text(path, self.to_json())
            return None
        return self.camera.save(path, format, approximate=approximate)

    @classmethod
    def load(cls, path: File) -> Calibration:
        """Read the JSON that `save` or `to_json` wrote, from a file's name or an open file.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            As `from_json`, with the file's name; also for a camera without its uncertainties.

        Examples
        --------
        >>> result.save("camera.json")
        >>> ts.Calibration.load("camera.json") == result
        True
        """
        text = read_text(path)
        with naming(path):
            if text.strip() and not text.lstrip().startswith(("{", "[")):
                raise ValueError(
                    "a calibration is JSON, as `save` writes it: `Camera.load` reads the files of "
                    "other programs"
                )
            return cls.from_json(text)

    @classmethod
    def from_json(cls, text: str) -> Calibration:
        """Read the JSON that `to_json` wrote; unknown keys are ignored.

        Raises
        ------
        ValueError
            If the text is not JSON, is of another format, or a key is missing, of the wrong type
            or not finite, or `std` contradicts `covariance`; the message names it.

        Examples
        --------
        >>> ts.Calibration.from_json(result.to_json()) == result
        True
        """
        members = JsonFields.parse(text, RESULT_FORMAT)
        size = len(members.texts("parameters"))
        covariance = members.array("covariance", (size, size))
        # Callers take square roots of the variances along its directions.
        if not _core.is_covariance(covariance):
            raise ValueError('"covariance" must be symmetric and positive semidefinite')
        image_size = members.integers("image_size")
        figures = members.objects("edges") if members.has("edges") else ()
        try:
            edges = tuple(edges_from_members(figure) for figure in figures)
        except NotEnoughDataError as error:
            raise ValueError(f'"edges": {error}') from error
        read = record_from_members(
            cls,
            members,
            camera=camera_from_members(members.object("camera"), image_size),
            covariance=covariance,
            edges=edges,
        )
        for name, variance in zip(read.parameters, covariance.diagonal(), strict=True):
            if not math.isclose(read.std[name], math.sqrt(variance), rel_tol=STD_TOLERANCE):
                raise ValueError(
                    f'"std.{name}" is {read.std[name]:g}, but "covariance" states '
                    f"{math.sqrt(variance):g}"
                )
        return read
