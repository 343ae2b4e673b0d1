"""The core's solution for what was gathered from photographs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import trisquare._core as _core
from trisquare.calibration.gather import Gathered
from trisquare.camera.settings import Settings
from trisquare.edges import PlaneEdges, changed_edges
from trisquare.errors import TrisquareError
from trisquare.images.faults import PictureFaults


def solve(
    figures: Sequence[PlaneEdges],
    gathered: Gathered,
    settings: Settings,
    choosing: bool,
    threads: int = 1,
) -> _core.Outcome:
    """Calibrate with the figures of all pictures; with `choosing`, false ones may be left out."""
    picture_numbers = {image: count for count, image in enumerate(gathered.images)}
    if any(image != count for image, count in picture_numbers.items()):
        # The core numbers only the pictures that are used.
        figures = [changed_edges(figure, image=picture_numbers[figure.image]) for figure in figures]
    return _outcome(
        figures,
        gathered.image_size,
        settings,
        choosing,
        gathered.faults,
        pictures=gathered.pictures or None,
        tones=[tone.curve for tone in gathered.tones],
        threads=threads,
        orthogonal=settings.orthogonal,
        parallel=settings.parallel,
    )


def solve_alone(
    figures: Sequence[PlaneEdges],
    gathered: Gathered,
    settings: Settings,
    choosing: bool,
) -> _core.Solution | None:
    """Calibrate with the edges of one picture; None if they do not determine a camera."""
    faults = gathered.faults[gathered.images.index(figures[0].image)]
    figures = [changed_edges(figure, image=0) for figure in figures]
    try:
        outcome = _outcome(
            figures, gathered.image_size, settings, choosing, [faults], pictures=None, tones=[]
        )
        return outcome.solution()
    except TrisquareError:
        return None


def _outcome(
    figures: Sequence[PlaneEdges],
    image_size: tuple[int, int],
    settings: Settings,
    choosing: bool,
    faults: Sequence[PictureFaults],
    **of_pictures: Any,
) -> _core.Outcome:
    return _core.calibrate(
        figures,
        image_size,
        choosing=choosing,
        method=settings.method,
        model=settings.model,
        fixed=settings.fixed,
        initial=settings.initial_camera(image_size),
        side_errors=[(own.side_error, own.line_error) for own in faults],
        free=settings.free,
        **of_pictures,
    )
