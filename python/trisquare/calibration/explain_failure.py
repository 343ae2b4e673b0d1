"""The errors of a calibration state what was found in the pictures, and what was rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from trisquare._support.number_text import listed
from trisquare.detection.kinds import TargetKinds
from trisquare.edges import PlaneEdges
from trisquare.errors import TrisquareError
from trisquare.images.pixels import ImageSource
from trisquare.images.reading import load_picture
from trisquare.results.partial_detection import PartialDetection, partial_detections
from trisquare.results.rejected import Rejected

MOST_NAMED = 3
"""Groups, and places in each, that a message names; the error's attributes hold all."""

MOST_EXPLAINED = 4
"""Pictures that are searched again for rejected shapes, those with the fewest targets first: with a
hundred pictures a failure must not take twice as long."""


@contextmanager
def raise_with_reasons(
    figures: Sequence[PlaneEdges],
    rejected: Sequence[Rejected],
    sources: Sequence[ImageSource],
    kinds: TargetKinds,
) -> Iterator[None]:
    """Add what was found and what was rejected to a `TrisquareError`: to its text and attributes.

    Parameters
    ----------
    figures : sequence of PlaneEdges
        What was measured.
    rejected : sequence of Rejected
        What is known to have been rejected.
    sources : sequence of path or ndarray
        The pictures.
    kinds : TargetKinds
        What was searched for.
    """
    try:
        yield
    except TrisquareError as error:
        # OpenCV is loaded where a picture is searched.
        from trisquare.measurement.rejection_reasons import rejection_reasons

        error.found = tuple(partial_detections(figures))
        counts = [sum(target.image == i for target in error.found) for i in range(len(sources))]
        explained = sorted(range(len(sources)), key=counts.__getitem__)[:MOST_EXPLAINED]
        error.rejected = (
            *rejected,
            *(
                replace(candidate, image=index)
                for index in sorted(explained)
                for candidate in rejection_reasons(load_picture(sources[index]), kinds)
            ),
        )
        texts = [str(error)]
        for heading, things in (("found", error.found), ("not used", error.rejected)):
            if things:
                texts.append(f"{heading}: {_named(things, len(sources) > 1)}")
        error.args = ("; ".join(texts),)
        raise


def _named(candidates: Sequence[PartialDetection | Rejected], several: bool) -> str:
    """Name targets by their places, those of one kind and reason together."""
    groups: dict[tuple[str, str, int], list[str]] = {}
    for candidate in candidates:
        x, y = candidate.corners.mean(axis=0).tolist()
        reason = f" ({candidate.reason})" if isinstance(candidate, Rejected) else ""
        group = groups.setdefault((candidate.kind, reason, candidate.image), [])
        group.append(f"({x:.0f}, {y:.0f})")
    texts = []
    for (kind, reason, image), places in list(groups.items())[:MOST_NAMED]:
        article = "an" if kind[:1] in "aeiou" else "a"
        name = f"{article} {kind}" if len(places) == 1 else f"{kind}s"
        picture = f" of picture {image}" if several else ""
        texts.append(f"{name} around {listed(places, MOST_NAMED)}{picture}{reason}")
    unnamed = sum(len(places) for places in list(groups.values())[MOST_NAMED:])
    return listed([*texts, f"{unnamed} more"] if unnamed else texts)
