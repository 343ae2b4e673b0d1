"""Texts that add what was found, and what was rejected, to the errors of a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trisquare._support.number_text import listed
from trisquare.calibration.gather import Gathered
from trisquare.calibration.unexplained_pictures import BOARDS
from trisquare.errors import NotEnoughPlanesError, TrisquareError
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.partial_detection import PartialDetection, partial_detections
from trisquare.results.rejected import Rejected

MORE_PICTURES = (
    "take more pictures of the board, each with the board tilted in another direction, and give "
    "them all at once"
)

INTERLACED = (
    "the odd rows were recorded at another time than the even rows, and the scene moved far in "
    "between: photograph without interlacing"
)

MAX_NAMED = 3
"""Maximum number of groups, and of positions in each, in a message; the error's attributes have
all."""


def add_reasons(error: TrisquareError, gathered: Gathered) -> None:
    """Add what was found and what was rejected to an error's text and attributes."""
    error.found = tuple(partial_detections(gathered.figures))
    error.rejected = (*gathered.rejected, *rejected_shapes(gathered))
    texts = [str(error)]
    if isinstance(error, NotEnoughPlanesError) and any(
        figure.kind in BOARDS for figure in gathered.figures
    ):
        texts.append(MORE_PICTURES)
    texts += interlaced(gathered)
    for heading, candidates in (("found", error.found), ("not used", error.rejected)):
        if candidates:
            texts.append(f"{heading}: {_named(candidates, gathered.names)}")
    error.args = ("; ".join(texts),)


def interlaced(gathered: Gathered) -> list[CalibrationWarning]:
    """Warn of pictures whose two fields are so far apart that hardly anything is measured well."""
    searches = sorted(gathered.searches.items())
    names = [gathered.names[index] for index, search in searches if search.is_interlaced()]
    if not names:
        return []
    return [CalibrationWarning(f"{INTERLACED} ({listed(names)})", "interlaced", "high")]


def rejected_shapes(gathered: Gathered) -> list[Rejected]:
    """Return the four-sided shapes of searched pictures that are not targets, with the reasons."""
    from trisquare.measurement.rejection_reasons import rejection_reasons

    return [
        replace(candidate, image=index)
        for index, search in sorted(gathered.searches.items())
        for candidate in rejection_reasons(search)
    ]


def _named(candidates: Sequence[PartialDetection | Rejected], pictures: Sequence[str]) -> str:
    """Name targets by their positions, grouped by kind, reason and picture.

    `pictures` are the names of all pictures in messages.
    """
    groups: dict[tuple[str, str, int], list[str]] = {}
    for candidate in candidates:
        x, y = candidate.corners.mean(axis=0).tolist()
        reason = f" ({candidate.reason})" if isinstance(candidate, Rejected) else ""
        group = groups.setdefault((candidate.kind, reason, candidate.image), [])
        group.append(f"({x:.0f}, {y:.0f})")
    texts = []
    for (kind, reason, image), places in list(groups.items())[:MAX_NAMED]:
        article = "an" if kind[:1] in "aeiou" else "a"
        name = f"{article} {kind}" if len(places) == 1 else f"{kind}s"
        picture = f" of {pictures[image]}" if len(pictures) > 1 else ""
        texts.append(f"{name} around {listed(places, MAX_NAMED)}{picture}{reason}")
    unnamed = sum(len(places) for places in list(groups.values())[MAX_NAMED:])
    return listed([*texts, f"{unnamed} more"] if unnamed else texts)
