"""A photograph with what was found in it and what was not used, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.drawing.canvas import Canvas, Colour, dimmed_grey, draw_legend, draw_lines
from trisquare.drawing.labels import Label, draw_labels, placed_label
from trisquare.images.pixels import Image
from trisquare.results.rejected import Rejected

FOUND_COLOUR: Colour = (90, 230, 90)
REJECTED_COLOUR: Colour = (70, 120, 255)

READABLE_SIZE = 1200
"""Longest side, in pixels, below which the picture is enlarged lest its labels cover it."""

MOST_ENLARGED = 8


class Place(Protocol):
    """Whatever has a place in a picture: a `Plane`, a `PartialDetection`, a `Rejected`."""

    @property
    def kind(self) -> str:
        """What it is called."""

    @property
    def image(self) -> int:
        """Index of the picture."""

    @property
    def corners(self) -> FloatArray:
        """Shape (4, 2), pixels."""


def draw_findings(
    image: Image, found: Sequence[Place], rejected: Sequence[Rejected], *, index: int = 0
) -> Canvas:
    """Draw where targets were found, and beside what was not used the reason.

    Parameters
    ----------
    image : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        Grey or BGR; float pictures are taken to span 0 to 1.
    found : sequence of Plane or PartialDetection
        What is drawn as accepted, numbered: ``result.planes``, or the ``found`` of an error.
    rejected : sequence of Rejected
        What is drawn as rejected.
    index : int
        Which of the pictures this is; what was seen in others is left out.

    Returns
    -------
    ndarray of uint8, shape (k H, k W, 3)
        BGR; k is 1 but for pictures so small that labels would cover them.
    """
    scale = _enlargement(image)
    canvas = np.repeat(np.repeat(dimmed_grey(image), scale, axis=0), scale, axis=1)
    accepted = [
        (f"{number} {place.kind}", FOUND_COLOUR, _enlarged(place.corners, scale))
        for number, place in enumerate(found)
        if place.image == index
    ]
    unused = [
        (_objection(candidate), REJECTED_COLOUR, _enlarged(candidate.corners, scale))
        for candidate in rejected
        if candidate.image == index
    ]
    entries = [
        (f"found: {len(accepted)}", FOUND_COLOUR),
        (f"not used: {len(unused)}", REJECTED_COLOUR),
    ]
    everything = [corners for _, _, corners in accepted + unused]
    taken = [draw_legend(canvas, entries, np.vstack([np.empty((0, 2)), *everything]))]
    labels: list[Label] = []
    for text, colour, corners in accepted + unused:
        labels.append(placed_label(canvas, text, colour, corners, taken))
        taken.append(labels[-1].box)
    draw_labels(canvas, labels)
    thickness = max(1, round(max(canvas.shape) / 1000))
    for places, width in ((unused, thickness), (accepted, 3 * thickness)):
        for _, colour, corners in places:
            draw_lines(canvas, [corners[[0, 1, 2, 3, 0]]], colour, width)
    return canvas


def _objection(candidate: Rejected) -> str:
    residual = "" if candidate.residual is None else f", {candidate.residual:.2g} px"
    return f"{candidate.kind}: {candidate.reason}{residual}"


def _enlargement(image: Image) -> int:
    return int(np.clip(np.ceil(READABLE_SIZE / max(image.shape[:2])), 1, MOST_ENLARGED))


def _enlarged(corners: FloatArray, scale: int) -> FloatArray:
    """Pixels of the enlarged picture: the centre of a pixel becomes that of its block."""
    return np.asarray(scale * corners + 0.5 * (scale - 1))
