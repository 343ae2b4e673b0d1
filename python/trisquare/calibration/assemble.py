"""Assembly of a `Calibration` from the core's solution and what the pictures showed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import ReadOnlyDict
from trisquare._support.records import of_core
from trisquare.calibration.explain_failure import interlaced
from trisquare.calibration.gather import Gathered
from trisquare.calibration.lone_holes import LONE_HOLE, lone_holes
from trisquare.calibration.solution_warnings import solution_warnings
from trisquare.calibration.unexplained_pictures import disagreement_text, unexplained_pictures
from trisquare.camera.camera import Camera
from trisquare.camera.settings import Settings
from trisquare.edges import PlaneEdges
from trisquare.images.tone import PictureTone, pooled
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning, by_severity
from trisquare.results.model_alternative import ModelAlternative
from trisquare.results.plane import Plane
from trisquare.results.pose_uncertainty import PoseUncertainty
from trisquare.results.residual_correlation import ResidualCorrelation
from trisquare.results.residuals import FigureResiduals
from trisquare.results.scene_line import SceneLine

UNFIT = {
    "barely_determined",
    "choice_uncertain",
    "correlated_residuals",
    "larger_rejected",
    "periodic_pattern",
    "pixels_not_square",
    "plane_rejected",
    "planes_contradict",
}
"""Codes of warnings about targets that are not consistent with one camera."""

OUTLIER = "it disagrees with all others"
"""Reason for leaving out a plane that a warning ``plane_rejected`` names."""


def assemble(
    found: _core.Solution,
    gathered: Gathered,
    settings: Settings,
    side: float | None,
    pictures: tuple[str, ...] = (),
) -> Calibration:
    """Return the core's solution as a `Calibration`; `pictures` are the names of the files."""
    figures = gathered.edges
    tones = _tones(found, gathered.tones)
    tone, tone_std = pooled(tones)
    sides = _sides(found, figures, side)
    coherence = _coherence(found.correlation)
    planes = _planes(found, gathered, sides, coherence)
    solution = list(
        solution_warnings(found, gathered, dict(zip(gathered.images, tones, strict=True)))
    )
    warnings = [
        *_causes(gathered, solution),
        *_disagreeing_pictures(planes, gathered, coherence),
        *gathered.warnings,
        *solution,
        *_holes_of_unknown_side(sides, side),
    ]
    return of_core(
        Calibration,
        camera=_camera(found, gathered, settings),
        std=ReadOnlyDict(found.std),
        covariance=found.covariance,
        parameters=tuple(found.parameters),
        planes=planes,
        rms=found.rms,
        noise_scale=found.noise_scale,
        warnings=tuple(by_severity(warnings)),
        method=settings.method,
        tone=tone,
        fixed=settings.fixed,
        orthogonal=settings.orthogonal,
        parallel=settings.parallel,
        stage=found.stage,
        alternatives=tuple(ModelAlternative(*other) for other in found.alternatives),
        coherence=coherence,
        tone_std=tone_std,
        rejected=tuple(gathered.rejected),
        edges=tuple(figure for figure in figures if figure.freedom != "line"),
        residuals=tuple(map(_figure_residuals, found.residuals)),
        lines=_scene_lines(found, figures),
        pictures=pictures,
    )


def _causes(gathered: Gathered, solution: Sequence[CalibrationWarning]) -> list[CalibrationWarning]:
    """Warn of interlaced pictures, which are looked for only after a warning of `UNFIT`."""
    codes = {warning.code for warning in (*gathered.warnings, *solution)}
    return [] if "interlaced" in codes or codes.isdisjoint(UNFIT) else interlaced(gathered)


def _tones(found: _core.Solution, by_edges: Sequence[PictureTone]) -> Sequence[PictureTone]:
    """Return the tone curves of the edges, refined by the fit to the pixels if there is one."""
    if not found.tones:
        return by_edges
    return [tone.refined(fit) for tone, fit in zip(by_edges, found.tones, strict=True)]


def _camera(found: _core.Solution, gathered: Gathered, settings: Settings) -> Camera:
    return of_core(
        Camera,
        K=found.camera_matrix,
        distortion=found.distortion,
        image_size=gathered.image_size,
        model=settings.model_of(found.model),
        valid_radius=None if found.valid_radius == math.inf else found.valid_radius,
    )


def _coherence(correlation: _core.ResidualCorrelation) -> ResidualCorrelation:
    return ResidualCorrelation(
        correlation.neighbours,
        correlation.probability,
        tuple(correlation.displacements),
        correlation.contradiction,
    )


def _figure_residuals(found: _core.FigureResiduals) -> FigureResiduals:
    return of_core(
        FigureResiduals,
        plane=found.plane,
        distances=tuple(found.distances),
        normals=tuple(found.normals),
    )


def _planes(
    found: _core.Solution,
    gathered: Gathered,
    sides: Sequence[float | None],
    coherence: ResidualCorrelation,
) -> tuple[Plane, ...]:
    """Return the planes in order; `sides` are the lengths of their units."""
    figures = gathered.edges
    images = gathered.images
    outliers = {own.plane for own in found.warnings if own.code == "plane_rejected"}
    side_errors = [own if coherence.sides_err_together else None for own in coherence.displacements]
    return tuple(
        _plane(
            plane,
            kind=figures[plane.figure].kind,
            image=images[plane.image] if images else plane.image,
            side=sides[number],
            side_error=side_errors[number],
            rejection=OUTLIER if number in outliers else None,
        )
        for number, plane in enumerate(found.planes)
    )


def _plane(found: _core.SolvedPlane, side_error: float | None, **members: Any) -> Plane:
    """Return a plane that the core found; `members` are its further attributes."""
    if found.uncertainty is not None:
        given_camera, by_camera = found.uncertainty
        members["uncertainty"] = of_core(
            PoseUncertainty, given_camera=given_camera, by_camera=by_camera, side_error=side_error
        )
    if found.aspect is not None:
        members["aspect"], members["aspect_std"] = found.aspect
    if found.radii:
        members["radii"], members["radii_std"] = map(np.array, zip(*found.radii, strict=True))
    return of_core(
        Plane,
        corners=found.corners,
        rotation=found.rotation,
        translation=found.translation,
        rms=found.rms,
        samples=found.samples,
        **members,
    )


def _sides(
    found: _core.Solution, figures: Sequence[PlaneEdges], side: float | None
) -> list[float | None]:
    """Return the length of every plane's unit: `side`, or None for a lone hole of a frame."""
    holes = lone_holes(figures)
    return [None if figures[plane.figure].plane in holes else side for plane in found.planes]


def _holes_of_unknown_side(
    sides: Sequence[float | None], side: float | None
) -> list[CalibrationWarning]:
    """Warn of the planes whose unit is not the stated side."""
    return [
        CalibrationWarning(
            f"plane {number} {LONE_HOLE}: side= is the frame's, so the pose of this plane is in "
            "units of the hole's side",
            "side_unknown",
            "medium",
            number,
        )
        for number, own in enumerate(sides)
        if side is not None and own is None
    ]


def _disagreeing_pictures(
    planes: Sequence[Plane], gathered: Gathered, coherence: ResidualCorrelation
) -> list[CalibrationWarning]:
    """Warn of pictures of another camera, a possible cause of other warnings."""
    unexplained = unexplained_pictures(planes, gathered.rejected, coherence.displacements)
    if not unexplained:
        return []
    names = gathered.names or [f"picture {image}" for image in range(max(unexplained) + 1)]
    text = disagreement_text([names[image] for image in unexplained])
    return [CalibrationWarning(text, "pictures_disagree", "high")]


def _scene_lines(found: _core.Solution, figures: Sequence[PlaneEdges]) -> tuple[SceneLine, ...]:
    """Return the lines of the scene with the reasons why some are not used."""
    agree = any(is_used for _, _, is_used in found.lines)
    curved = "it is not straight under the lens that the other lines and the planes show"
    unusable = "no line agrees with the planes"
    lines = []
    for index, rms, is_used in found.lines:
        reason = curved if agree else unusable
        if rms is None:
            reason = "the lens does not see all of it"
        points, image = figures[index].points[0], figures[index].image
        lines.append(SceneLine(image, points, rms, None if is_used else reason))
    return tuple(lines)
