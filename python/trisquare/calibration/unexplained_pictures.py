"""Pictures that one camera does not explain together with the others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from trisquare.calibration.select import FALSE_PLANE_REASON
from trisquare.results.plane import Plane
from trisquare.results.rejected import Rejected

BOARDS = ("chessboard", "charuco", "sheet")
"""Kinds that are not found by chance."""

MIN_PLANES = 3
"""Minimum number of planes that do not fit for a common cause: one or two squares may be false."""

MIN_BOARDS = 2
"""Minimum number of boards that do not fit for a common cause."""

MAX_DISPLACEMENT_RATIO = 10.0
"""Ratio of the displacement of a plane's sides to that of the flattest plane, above which the plane
is not bent but was seen by another camera. The boards of real sets differ by a factor below 2."""

FLAT_DISPLACEMENT = 0.05
"""Displacement (px) up to which a plane counts as flat, even if that of the flattest is far
smaller."""


def unexplained_pictures(
    planes: Sequence[Plane], rejected: Iterable[Rejected], displacements: Sequence[float]
) -> list[int]:
    """Return the pictures in which no plane fits the camera of the others, unless these are few.

    `displacements` are, for every plane, the rms (px) of the errors that the samples of a side have
    in common. Only those of the `rejected` count that the choice among candidates left out.
    """
    used = [index for index in range(len(planes)) if planes[index].rejection is None]
    limit = max(
        MAX_DISPLACEMENT_RATIO * min((displacements[index] for index in used), default=0.0),
        FLAT_DISPLACEMENT,
    )
    fitting = {planes[index].image for index in used if displacements[index] <= limit}
    kinds = [(plane.image, plane.kind) for plane in planes]
    kinds += [
        (candidate.image, candidate.kind)
        for candidate in rejected
        if candidate.reason == FALSE_PLANE_REASON
    ]
    unexplained = [(image, kind) for image, kind in kinds if image not in fitting]
    boards = sum(kind in BOARDS for _, kind in unexplained)
    if len(unexplained) < MIN_PLANES and boards < MIN_BOARDS:
        return []
    return sorted({image for image, _ in unexplained})


def disagreement_text(pictures: Sequence[str]) -> str:
    """Return the warning about unexplained pictures, given their names."""
    return (
        f"no single camera explains all pictures: no flat target in {', '.join(pictures)} fits "
        "the camera of the other pictures. Was another zoom, focus or camera used, or were "
        "pictures turned, cropped or stabilised? Calibrate those pictures separately"
    )
