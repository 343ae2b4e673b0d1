"""Pictures of different cameras, as calibrations of each picture alone show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import trisquare._core as _core
from trisquare._support.number_text import listed, plus_minus
from trisquare.calibration.gather import Gathered
from trisquare.calibration.solve import solve_alone
from trisquare.camera.settings import FREEABLE, Settings
from trisquare.edges import PlaneEdges
from trisquare.results.calibration_warning import CalibrationWarning

MAX_PICTURES = 10
"""Maximum number of pictures that are calibrated alone: the spread over more shows the same."""

MIN_DEVIATIONS = 6.0
"""Difference of two cameras, in its standard deviations, above which they are not the same. It was
up to 3.2 for 115 pairs of pictures of one camera, and 4.7 to 214 for 100 with a zoom of 0.2 to
1.2 % between them (renderings of two or three planes each, edges known to 0.01 px)."""

MIN_DIFFERENCE = 0.001
"""Smallest difference that counts, as a fraction of the focal length or of the picture's width."""

PLACES = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}
"""Row and column in the camera matrix of the parameters that are compared."""


def differing_pictures(
    candidates: Sequence[PlaneEdges],
    gathered: Gathered,
    settings: Settings,
    choosing: bool,
    joint: _core.Solution,
) -> list[CalibrationWarning]:
    """Warn of pictures whose cameras, each determined by the picture alone, are not the same.

    `candidates` are the figures of all pictures, with those that the calibration of all pictures
    (`joint`) leaves out.
    """
    by_picture = {
        image: list(figures) for image, figures in groupby(candidates, lambda figure: figure.image)
    }
    has_relations = bool(settings.orthogonal or settings.parallel)
    if not 1 < len(by_picture) <= MAX_PICTURES or settings.method == "linear" or has_relations:
        return []
    settings = _settings_alone(settings, joint)
    alone = {
        image: solve_alone(figures, gathered, settings, choosing)
        for image, figures in by_picture.items()
    }
    known = {
        image: solution
        for image, solution in alone.items()
        if solution is not None and not _is_doubted(solution)
    }
    width = gathered.image_size[0]
    differing = {image: _differing_from(image, known, width) for image in known}
    differing = {image: others for image, others in differing.items() if others}
    if not differing:
        return []
    reference = min(differing, key=lambda image: len(differing[image]))
    return [_warning(reference, differing[reference], known, gathered.names)]


def _settings_alone(settings: Settings, joint: _core.Solution) -> Settings:
    """Return the settings for one picture: the joint model, and a free skew if it may be needed.

    Pictures that are sheared in the same way would otherwise lead to different cameras.
    """
    is_sheared = any(warning.code == "pixels_not_square" for warning in joint.warnings)
    free = FREEABLE if is_sheared else settings.free
    return replace(settings, model=joint.model, free=free)


def _is_doubted(solution: _core.Solution) -> bool:
    return any(warning.severity == "high" for warning in solution.warnings)


def _differing_from(
    reference: int, known: Mapping[int, _core.Solution], width: int
) -> dict[int, tuple[float, str]]:
    """Return the pictures with another camera than `reference`.

    With each, its most significant difference: standard deviations, and the parameter's name.
    """
    found = {}
    for image in known:
        differences = list(_differences(known[image], known[reference], width))
        if differences:
            found[image] = max(differences)
    return found


def _differences(
    one: _core.Solution, other: _core.Solution, width: int
) -> Iterator[tuple[float, str]]:
    for name, place in PLACES.items():
        if name not in one.std or name not in other.std:
            continue
        value = one.camera_matrix[place]
        difference = abs(value - other.camera_matrix[place])
        deviations = difference / math.hypot(one.std[name], other.std[name])
        scale = value if place[0] == place[1] else width
        if deviations > MIN_DEVIATIONS and difference > MIN_DIFFERENCE * scale:
            yield deviations, name


def _warning(
    reference: int,
    differing: Mapping[int, tuple[float, str]],
    known: Mapping[int, _core.Solution],
    names: Sequence[str],
) -> CalibrationWarning:
    worst = max(differing, key=lambda image: differing[image])
    parameter = differing[worst][1]
    values = {
        image: plus_minus(
            known[image].camera_matrix[PLACES[parameter]], known[image].std[parameter]
        )
        for image in (worst, reference)
    }
    others = [names[image] for image in differing if image != worst]
    also = f" (also not of the camera of {names[reference]}: {listed(others)})" if others else ""
    text = (
        f"the pictures are not of one camera: calibrated alone, {names[worst]} "
        f"has {parameter} {values[worst]}, and {names[reference]} {values[reference]}{also}. Was "
        "another zoom, focus or camera used, or were pictures turned, cropped or stabilised? "
        "Calibrate the pictures of each camera separately"
    )
    return CalibrationWarning(text, "pictures_disagree", "high")
