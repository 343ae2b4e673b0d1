"""Telling, when a calibration fails, what was found in the pictures, where, and what was not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeAlias

from trisquare.detection.kinds import TargetKinds
from trisquare.edges import PlaneEdges
from trisquare.errors import TrisquareError
from trisquare.images.pixels import Image, ImageSource
from trisquare.images.reading import load_picture
from trisquare.results.partial_detection import PartialDetection, partial_detections
from trisquare.results.rejected import Rejected

MOST_NAMED = 3
"""Groups of things, and places in each, that a message names; the error's attributes hold all."""

MOST_EXPLAINED = 4
"""Pictures that are searched again for what was passed over, those with the least found first: a
failure shall not take twice as long when there are a hundred."""

Place: TypeAlias = PartialDetection | Rejected


@contextmanager
def raise_with_reasons(
    figures: Sequence[PlaneEdges],
    rejected: Sequence[Rejected],
    sources: Sequence[ImageSource],
    targets: TargetKinds,
) -> Iterator[None]:
    """Let a `TrisquareError` say what was found in the pictures, in words and as attributes.

    Parameters
    ----------
    figures : sequence of PlaneEdges
        What was measured.
    rejected : sequence of Rejected
        What is known to have been rejected.
    sources : sequence of path or ndarray
        The pictures.
    targets : TargetKinds
        What was looked for.
    """
    try:
        yield
    except TrisquareError as error:
        error.found = tuple(partial_detections(figures))
        error.rejected = (*rejected, *_passed_over(error.found, sources, targets))
        several = len(sources) > 1
        texts = [str(error)]
        if error.found:
            texts.append(f"found: {_named(error.found, several)}")
        if error.rejected:
            texts.append(f"not used: {_named(error.rejected, several)}")
        error.args = ("; ".join(texts),)
        raise


def explain(picture: Image, targets: TargetKinds) -> list[Rejected]:
    """Say which four-sided things of a checked picture the search passes over, and why."""
    from trisquare.detection.grey import grey_bytes
    from trisquare.measurement.find import find  # OpenCV is loaded where a picture is searched
    from trisquare.measurement.rejection_reasons import passed_over

    if not targets.squares:
        return []
    found = [target for target in find(picture, targets) if not isinstance(target, Rejected)]
    return passed_over(grey_bytes(picture), found)


def _passed_over(
    found: Sequence[PartialDetection], sources: Sequence[ImageSource], targets: TargetKinds
) -> list[Rejected]:
    counts = [sum(target.image == index for target in found) for index in range(len(sources))]
    poorest = sorted(range(len(sources)), key=lambda index: counts[index])[:MOST_EXPLAINED]
    return [
        replace(candidate, image=index)
        for index in sorted(poorest)
        for candidate in explain(load_picture(sources[index]), targets)
    ]


def _named(things: Sequence[Place], several: bool) -> str:
    """Name things with their places, alike ones together and the first of them only."""
    alike: dict[tuple[str, str, int], list[str]] = {}
    for thing in things:
        x, y = thing.corners.mean(axis=0).tolist()
        reason = thing.reason if isinstance(thing, Rejected) else ""
        alike.setdefault((thing.kind, reason, thing.image), []).append(f"({x:.0f}, {y:.0f})")
    groups = []
    for (kind, reason, image), places in list(alike.items())[:MOST_NAMED]:
        article = "an" if kind[:1] in "aeiou" else "a"
        name = f"{article} {kind}" if len(places) == 1 else f"{kind}s"
        shown = places[:MOST_NAMED]
        if len(places) > MOST_NAMED:
            shown.append(f"{len(places) - MOST_NAMED} more")
        picture = f" of picture {image}" if several else ""
        groups.append(
            f"{name} around {_listed(shown)}{picture}" + (f" ({reason})" if reason else "")
        )
    if len(alike) > MOST_NAMED:
        unnamed = sum(len(places) for places in list(alike.values())[MOST_NAMED:])
        groups.append(f"{unnamed} more")
    return _listed(groups)


def _listed(texts: list[str]) -> str:
    return " and ".join([text for text in (", ".join(texts[:-1]), texts[-1]) if text])
