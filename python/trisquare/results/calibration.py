"""The results of a calibration: frozen, checked, and exact through JSON and pickle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy.typing as npt

from trisquare._core import __version__
from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    instances,
    is_covariance,
    not_negative,
    real_array,
    real_number,
    string,
    strings,
)
from trisquare._support.json_members import JsonFields, dump_members
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.camera.members import camera_from_members, camera_members
from trisquare.camera.projection_uncertainty import (
    ProjectionMap,
    projection_covariance,
    projection_map,
    rms_displacement,
)
from trisquare.edges import PlaneEdges, edges_from_members, edges_members
from trisquare.results.model_alternative import (
    ModelAlternative,
    alternative_from_members,
    alternative_members,
)
from trisquare.results.plane import Plane
from trisquare.results.pose_uncertainty import (
    PoseUncertainty,
    uncertainty_from_members,
    uncertainty_members,
)
from trisquare.results.rejected import Rejected, rejected_from_members, rejected_members
from trisquare.results.residual_correlation import (
    ResidualCorrelation,
    residual_correlation_from_members,
    residual_correlation_members,
)
from trisquare.results.residuals import FigureResiduals, residuals_from_members, residuals_members

__all__ = ["Calibration", "Camera", "Plane"]

RESULT_FORMAT = "trisquare/1"


@dataclass(frozen=True, slots=True, eq=False)
class Calibration(RebuiltByConstructor):
    """A camera with its uncertainty, and the planes that it was calibrated from.

    Parameters
    ----------
    camera : Camera
        The estimate.
    std : mapping of str to float
        One standard deviation of each free parameter, by name; with the aspect ratio held,
        ``std["fy"]`` equals ``std["fx"]`` although ``fy`` is not among `parameters`.
    covariance : array_like, shape (n, n)
        Of the free parameters, in the order of `parameters`.
    parameters : sequence of str
        Names of the free parameters: of ``fx fy cx cy k1 k2 k3 p1 p2``.
    planes : sequence of Plane
        The physical planes.
    rms : float
        Root mean square residual of all edge samples, in pixels.
    noise_scale : float
        The residuals' spread relative to the stated standard deviations; the covariance is
        scaled by its square.
    warnings : sequence of str
        What a reader should know before trusting the numbers.
    method : str
        ``"ml"`` or ``"linear"``.
    tone : str, float or None
        Tone curve the pixels were read with; None if there were no pixels. An estimated one is
        given as the pure gamma that codes mid-grey (18 % of white) alike.
    fixed : sequence of str
        What was held: of ``aspect``, ``principal_point``, ``focal``, ``distortion``.
    stage : str
        The stage of the pipeline that the numbers come from.
    software : str
        Version of trisquare that computed it.
    alternatives : sequence of ModelAlternative
        The models that ``model="auto"`` rejected, the simplest first; empty unless it chose.
    coherence : ResidualCorrelation, optional
        How far the residuals are from independent noise, which the covariance allows for; None
        in results of versions that did not ask.
    rejected : sequence of Rejected
        What was found in the pictures but not used, and why.
    tone_std : float, optional
        One standard deviation of an estimated gamma; None where the tone curve was stated.
    edges : sequence of PlaneEdges
        What it was calibrated from; empty in results that were read from JSON without them.
    residuals : sequence of FigureResiduals
        How far the samples of each of the edges are from the calibrated model.
    """

    camera: Camera
    std: Mapping[str, float]
    covariance: FloatArray
    parameters: tuple[str, ...]
    planes: tuple[Plane, ...]
    rms: float
    noise_scale: float
    warnings: tuple[str, ...]
    method: str
    tone: str | float | None
    fixed: tuple[str, ...]
    stage: str
    software: str = __version__
    alternatives: tuple[ModelAlternative, ...] = ()
    tone_std: float | None = None
    coherence: ResidualCorrelation | None = None
    rejected: tuple[Rejected, ...] = ()
    edges: tuple[PlaneEdges, ...] = ()
    residuals: tuple[FigureResiduals, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise TypeError(f"camera must be a Camera, not {type(self.camera).__name__}")
        planes = instances(self.planes, Plane, "planes")
        parameters = strings(self.parameters, "parameters")
        size = len(parameters)
        covariance = real_array(self.covariance, "covariance", (size, size))
        std = {
            string(name, "std's key"): not_negative(value, f"std[{name!r}]")
            for name, value in dict(self.std).items()
        }
        missing = [name for name in parameters if name not in std]
        if missing:
            raise ValueError(f"std lacks the free parameters {', '.join(missing)}")
        tone = self.tone
        if tone is not None and not isinstance(tone, str):
            tone = real_number(tone, "tone")
        object.__setattr__(self, "std", MappingProxyType(std))
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "planes", planes)
        object.__setattr__(self, "rms", not_negative(self.rms, "rms"))
        object.__setattr__(self, "noise_scale", not_negative(self.noise_scale, "noise_scale"))
        object.__setattr__(self, "warnings", strings(self.warnings, "warnings"))
        object.__setattr__(self, "tone", tone)
        if self.tone_std is not None:
            object.__setattr__(self, "tone_std", not_negative(self.tone_std, "tone_std"))
        object.__setattr__(self, "fixed", strings(self.fixed, "fixed"))
        if self.coherence is not None and not isinstance(self.coherence, ResidualCorrelation):
            raise TypeError("coherence must be of the class ResidualCorrelation")
        alternatives = instances(self.alternatives, ModelAlternative, "alternatives")
        object.__setattr__(self, "alternatives", alternatives)
        rejected = instances(self.rejected, Rejected, "rejected")
        object.__setattr__(self, "rejected", rejected)
        edges = instances(self.edges, PlaneEdges, "edges")
        residuals = instances(self.residuals, FigureResiduals, "residuals")
        _check_residuals(edges, residuals, len(planes))
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "residuals", residuals)
        for name in ("method", "stage", "software"):
            string(getattr(self, name), name)

    def __repr__(self) -> str:
        width, height = self.camera.image_size
        lines = [
            f"Calibration of a {width} x {height} camera "
            f"({self.camera.model}, {self.method}, from the {self.stage} stage)"
        ]
        for name, value in camera_parameters(self.camera).items():
            if name in self.std:
                lines.append(f"  {name}  {value:12.6g}  std {self.std[name]:.2g}")
            elif value != 0:
                lines.append(f"  {name}  {value:12.6g}  held")
        lines.append(
            f"  rms {self.rms:.3g} px over {len(self.planes)} planes, "
            f"noise scale {self.noise_scale:.3g}"
        )
        lines.extend(f"  warning: {warning}" for warning in self.warnings)
        return "\n".join(lines)

    def projection_covariance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the covariances of where the directions seen at pixels are projected.

        The uncertainty that counts for whoever uses the camera: a viewing direction, fixed in the
        camera's frame, is projected by a camera that is known so well; the parameters' own
        uncertainties may cancel or add up.

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
        """
        return projection_covariance(
            self.camera, self.parameters, self._aspect_fixed, self.covariance, points
        )

    def projection_std(self, points: npt.ArrayLike) -> FloatArray:
        """Return how far the projections of the directions seen at pixels may be off.

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
        """
        return rms_displacement(self.projection_covariance(points))

    def projection_map(self, step: float | None = None) -> ProjectionMap:
        """Return `projection_std` on a grid over the picture, border to border.

        Parameters
        ----------
        step : float, optional
            The grid's lines are at most so many pixels apart; by default a 32nd of the width.

        Returns
        -------
        ProjectionMap
            ``x``, ``y`` and ``std[row, column]``, infinite beyond the valid radius.
        """
        return projection_map(
            self.camera, self.parameters, self._aspect_fixed, self.covariance, step
        )

    @property
    def _aspect_fixed(self) -> bool:
        """Whether ``fy`` follows ``fx``."""
        return "aspect" in self.fixed and "fx" in self.parameters

    def to_json(self, *, edges: bool = False) -> str:
        """Return the result as JSON text that `from_json` reads back exactly.

        Parameters
        ----------
        edges : bool
            Whether the measured edges and their residuals are part of it; they are most of it.
        """
        return dump_members(
            {
                "format": RESULT_FORMAT,
                "software": self.software,
                "method": self.method,
                "stage": self.stage,
                "tone": self.tone,
                **({} if self.tone_std is None else {"tone_std": self.tone_std}),
                "fixed": list(self.fixed),
                "image_size": list(self.camera.image_size),
                "camera": camera_members(self.camera),
                "std": dict(self.std),
                "parameters": list(self.parameters),
                "covariance": self.covariance.tolist(),
                "rms_px": self.rms,
                "noise_scale": self.noise_scale,
                "planes": [_plane_members(plane) for plane in self.planes],
                "warnings": list(self.warnings),
                **_alternatives_member(self.alternatives),
                **_coherence_member(self.coherence),
                **_rejected_member(self.rejected),
                **(_edges_members(self) if edges else {}),
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Calibration:
        """Read what `to_json` wrote; keys that are not known are ignored.

        Raises
        ------
        ValueError
            If the text is not JSON, is of another format, or a key is missing, of the wrong type
            or not finite; the message names it.
        """
        members = JsonFields.parse(text, RESULT_FORMAT)
        parameters = members.texts("parameters")
        tone = members.value("tone")
        return cls(
            camera=camera_from_members(members.object("camera"), members.integers("image_size")),
            std=members.numbers_by_name("std"),
            covariance=_covariance_member(members, len(parameters)),
            parameters=parameters,
            planes=tuple(_plane_from_members(plane) for plane in members.objects("planes")),
            rms=members.number("rms_px"),
            noise_scale=members.number("noise_scale"),
            warnings=members.texts("warnings"),
            method=members.text("method"),
            tone=tone if tone is None or isinstance(tone, str) else members.number("tone"),
            fixed=members.texts("fixed"),
            stage=members.text("stage"),
            software=members.text("software"),
            alternatives=tuple(
                alternative_from_members(other) for other in _optional(members, "alternatives")
            ),
            tone_std=members.number("tone_std") if members.has("tone_std") else None,
            coherence=(
                residual_correlation_from_members(members.object("coherence"))
                if members.has("coherence")
                else None
            ),
            rejected=tuple(
                rejected_from_members(candidate) for candidate in _optional(members, "rejected")
            ),
            edges=tuple(edges_from_members(figure) for figure in _optional(members, "edges")),
            residuals=tuple(residuals_from_members(own) for own in _optional(members, "residuals")),
        )


def _check_residuals(
    edges: tuple[PlaneEdges, ...], residuals: tuple[FigureResiduals, ...], planes: int
) -> None:
    """Raise ValueError unless the residuals are those of the edges."""
    samples = [[len(points) for points in figure.points] for figure in edges]
    distances = [[len(own) for own in figure.distances] for figure in residuals]
    if samples != distances:
        raise ValueError("residuals must be those of the edges: one for each sample")
    if any(own.plane >= planes for own in residuals):
        raise ValueError(f"residuals must be of one of the {planes} planes")


def _edges_members(calibration: Calibration) -> dict[str, Any]:
    """Return the ``edges`` and ``residuals`` members, which are there only if asked for."""
    return {
        "edges": [edges_members(figure) for figure in calibration.edges],
        "residuals": [residuals_members(own) for own in calibration.residuals],
    }


def _optional(members: JsonFields, name: str) -> Sequence[JsonFields]:
    """Return a list of objects that may be missing."""
    return members.objects(name) if members.has(name) else ()


def _covariance_member(members: JsonFields, size: int) -> FloatArray:
    """Read a covariance, whose directions must have variances: numpy takes their roots."""
    covariance = members.array("covariance", (size, size))
    if not is_covariance(covariance):
        raise ValueError('"covariance" must be symmetric and positive semidefinite')
    return covariance


def _coherence_member(coherence: ResidualCorrelation | None) -> dict[str, Any]:
    """Return the ``coherence`` member, which older results lack."""
    return {} if coherence is None else {"coherence": residual_correlation_members(coherence)}


def _alternatives_member(alternatives: tuple[ModelAlternative, ...]) -> dict[str, Any]:
    """Return the ``alternatives`` member, which is there only where models were compared."""
    members = [alternative_members(other) for other in alternatives]
    return {"alternatives": members} if members else {}


def _rejected_member(rejected: tuple[Rejected, ...]) -> dict[str, Any]:
    """Return the ``rejected`` member, which is there only where something was."""
    members = [rejected_members(candidate) for candidate in rejected]
    return {"rejected": members} if members else {}


def _plane_members(plane: Plane) -> dict[str, Any]:
    return {
        "kind": plane.kind,
        "image": plane.image,
        "corners": plane.corners.tolist(),
        "rotation": plane.rotation.tolist(),
        "translation": plane.translation.tolist(),
        "rms_px": plane.rms,
        "samples": plane.samples,
        **_uncertainty_member(plane.uncertainty),
    }


def _uncertainty_member(uncertainty: PoseUncertainty | None) -> dict[str, Any]:
    """Return a plane's ``pose_uncertainty`` member, which older results lack."""
    return {} if uncertainty is None else {"pose_uncertainty": uncertainty_members(uncertainty)}


def _plane_from_members(members: JsonFields) -> Plane:
    return Plane(
        kind=members.text("kind"),
        image=members.integer("image"),
        corners=members.array("corners", (4, 2)),
        rotation=members.array("rotation", (3, 3)),
        translation=members.array("translation", (3,)),
        rms=members.number("rms_px"),
        samples=members.integer("samples"),
        uncertainty=(
            uncertainty_from_members(members.object("pose_uncertainty"))
            if members.has("pose_uncertainty")
            else None
        ),
    )
