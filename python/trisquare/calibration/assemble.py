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

INCONSISTENCY_CODES = {
    "barely_determined",
    "choice_uncertain",
    "correlated_residuals",
    "larger_rejected",
    "periodic_pattern",
    "pixels_not_square",
    "plane_rejected",
    "plane_stretched",
    "planes_contradict",
}
"""Codes of warnings about targets that are not consistent with one camera."""

OUTLIER_REASON = "it disagrees with all others"
"""Reason for leaving out a plane that a warning ``plane_rejected`` names."""


def assemble(
    solution: _core.Solution,
    gathered: Gathered,
    settings: Settings,
    side: float | None,
    pictures: tuple[str, ...] = (),
) -> Calibration:
    """Return the core's solution as a `Calibration`; `pictures` are the names of the files."""
    figures = gathered.edges
    tones = _tones(solution, gathered.tones)
    tone, tone_std = pooled(tones)
    sides = _sides(solution, figures, side)
    coherence = _coherence(solution.correlation)
    planes = _planes(solution, gathered, sides, coherence)
    fit_warnings = list(
        solution_warnings(solution, gathered, dict(zip(gathered.images, tones, strict=True)))
    )
    warnings = [
        *_interlaced_warnings(gathered, fit_warnings),
        *_disagreeing_pictures(planes, gathered, coherence),
        *gathered.warnings,
        *fit_warnings,
        *_unknown_side_warnings(sides, side),
    ]
    return of_core(
        Calibration,
        camera=_camera(solution, gathered, settings),
        std=ReadOnlyDict(solution.std),
        covariance=solution.covariance,
        parameters=tuple(solution.parameters),
        planes=planes,
        rms=solution.rms,
        noise_scale=solution.noise_scale,
        warnings=tuple(by_severity(warnings)),
        method=settings.method,
        tone=tone,
        fixed=settings.fixed,
        orthogonal=settings.orthogonal,
        parallel=settings.parallel,
        stage=solution.stage,
        alternatives=tuple(ModelAlternative(*alternative) for alternative in solution.alternatives),
        coherence=coherence,
        tone_std=tone_std,
        rejected=tuple(gathered.rejected),
        edges=tuple(figure for figure in figures if figure.freedom != "line"),
        residuals=tuple(map(_figure_residuals, solution.residuals)),
        lines=_scene_lines(solution, figures),
        pictures=pictures,
    )


def _interlaced_warnings(
    gathered: Gathered, fit_warnings: Sequence[CalibrationWarning]
) -> list[CalibrationWarning]:
    """Warn of interlaced pictures, looked for only after a warning of `INCONSISTENCY_CODES`."""
    codes = {warning.code for warning in (*gathered.warnings, *fit_warnings)}
    if "interlaced" in codes or codes.isdisjoint(INCONSISTENCY_CODES):
        return []
    return interlaced(gathered)


def _tones(solution: _core.Solution, edge_tones: Sequence[PictureTone]) -> Sequence[PictureTone]:
    """Return the tone curves of the edges, refined by the fit to the pixels if there is one."""
    if not solution.tones:
        return edge_tones
    return [tone.refined(fit) for tone, fit in zip(edge_tones, solution.tones, strict=True)]


def _camera(solution: _core.Solution, gathered: Gathered, settings: Settings) -> Camera:
    return of_core(
        Camera,
        K=solution.camera_matrix,
        distortion=solution.distortion,
        image_size=gathered.image_size,
        model=settings.model_of(solution.model),
        valid_radius=None if solution.valid_radius == math.inf else solution.valid_radius,
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
    solution: _core.Solution,
    gathered: Gathered,
    sides: Sequence[float | None],
    coherence: ResidualCorrelation,
) -> tuple[Plane, ...]:
    """Return the planes in order; `sides` are the lengths of their units."""
    figures = gathered.edges
    images = gathered.images
    outliers = {warning.plane for warning in solution.warnings if warning.code == "plane_rejected"}
    side_errors = [
        displacement if coherence.sides_err_together else None
        for displacement in coherence.displacements
    ]
    return tuple(
        _plane(
            plane,
            kind=figures[plane.figure].kind,
            image=images[plane.image] if images else plane.image,
            side=sides[number],
            side_error=side_errors[number],
            rejection=OUTLIER_REASON if number in outliers else None,
        )
        for number, plane in enumerate(solution.planes)
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
    solution: _core.Solution, figures: Sequence[PlaneEdges], side: float | None
) -> list[float | None]:
    """Return the length of every plane's unit: `side`, or None for a lone hole of a frame."""
    holes = lone_holes(figures)
    return [None if figures[plane.figure].plane in holes else side for plane in solution.planes]


def _unknown_side_warnings(
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
        for number, unit in enumerate(sides)
        if side is not None and unit is None
    ]


def _disagreeing_pictures(
    planes: Sequence[Plane], gathered: Gathered, coherence: ResidualCorrelation
) -> list[CalibrationWarning]:
    """Warn of pictures of another camera, a possible cause of other warnings."""
    if any(warning.code == "pictures_disagree" for warning in gathered.warnings):
        return []
    unexplained = unexplained_pictures(planes, gathered.rejected, coherence.displacements)
    if not unexplained:
        return []
    names = gathered.names or [f"picture {image}" for image in range(max(unexplained) + 1)]
    text = disagreement_text([names[image] for image in unexplained])
    return [CalibrationWarning(text, "pictures_disagree", "high")]


def _scene_lines(solution: _core.Solution, figures: Sequence[PlaneEdges]) -> tuple[SceneLine, ...]:
    """Return the lines of the scene with the reasons why some are not used."""
    has_used_line = any(is_used for _, _, is_used in solution.lines)
    curved = "it is not straight with the distortion that the other lines and the planes determine"
    unusable = "no line agrees with the planes"
    lines = []
    for index, rms, is_used in solution.lines:
        reason = curved if has_used_line else unusable
        if rms is None:
            reason = "a part of it lies beyond the valid radius of the lens"
        points, image = figures[index].points[0], figures[index].image
        lines.append(SceneLine(image, points, rms, None if is_used else reason))
    return tuple(lines)
