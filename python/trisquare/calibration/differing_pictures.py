"""Pictures of different cameras, as calibrations of each picture alone show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, groupby

import trisquare._core as _core
from trisquare._support.number_text import listed, plus_minus
from trisquare.calibration.gather import Gathered
from trisquare.calibration.solve import solve_alone
from trisquare.camera.settings import Settings
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


@dataclass(frozen=True)
class _Difference:
    """The most significant difference of two pictures' cameras."""

    deviations: float
    text: str


def differing_pictures(
    candidates: Sequence[PlaneEdges], gathered: Gathered, settings: Settings, choosing: bool
) -> list[CalibrationWarning]:
    """Warn of pictures whose cameras, each determined by the picture alone, are not the same.

    `candidates` are the figures of all pictures, with those that the joint calibration leaves out.
    """
    by_picture = {
        image: list(figures) for image, figures in groupby(candidates, lambda own: own.image)
    }
    has_relations = bool(settings.orthogonal or settings.parallel)
    if not 1 < len(by_picture) <= MAX_PICTURES or settings.method == "linear" or has_relations:
        return []
    alone = {
        image: solve_alone(figures, gathered, settings, choosing)
        for image, figures in by_picture.items()
    }
    known = {image: own for image, own in alone.items() if own is not None and not _is_doubted(own)}
    differences = {
        (one, other): difference
        for one, other in combinations(known, 2)
        if (difference := _difference(known[one], known[other], gathered.image_size[0])) is not None
    }
    if not differences:
        return []
    worst = max(differences.values(), key=lambda own: own.deviations)
    reference = min(known, key=lambda image: sum(image in pair for pair in differences))
    others = sorted({image for pair in differences if reference in pair for image in pair})
    others.remove(reference)
    names = listed([gathered.names[image] for image in others])
    text = (
        f"the pictures are not of one camera: alone, {names} and {gathered.names[reference]} give "
        f"different ones ({worst.text}). Was another zoom, focus or camera used, or were pictures "
        "turned, cropped or stabilised? Calibrate those of each camera on their own"
    )
    return [CalibrationWarning(text, "pictures_disagree", "high")]


def _is_doubted(solution: _core.Solution) -> bool:
    return any(warning.severity == "high" for warning in solution.warnings)


def _difference(one: _core.Solution, other: _core.Solution, width: int) -> _Difference | None:
    """Return the most significant difference of two cameras; None if they may be the same."""
    found = None
    for name, place in PLACES.items():
        if name not in one.std or name not in other.std:
            continue
        value, other_value = one.camera_matrix[place], other.camera_matrix[place]
        apart = abs(value - other_value)
        scale = value if place[0] == place[1] else width
        deviations = apart / math.hypot(one.std[name], other.std[name])
        if apart < MIN_DIFFERENCE * scale or deviations < MIN_DEVIATIONS:
            continue
        if found is None or deviations > found.deviations:
            value_text = plus_minus(value, one.std[name])
            other_text = plus_minus(other_value, other.std[name])
            found = _Difference(deviations, f"{name} {value_text} and {other_text}")
    return found
