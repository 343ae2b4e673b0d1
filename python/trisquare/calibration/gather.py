"""Gathering what the photographs of a calibration show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.calibration.select import Chosen
from trisquare.detection.kinds import TargetKinds, nothing_found
from trisquare.edges import PlaneEdges
from trisquare.images.photographs import Photograph, photographs
from trisquare.images.pixels import ImageSource, Outlines, Tone, checked_tone, picture_size, tone_of
from trisquare.images.tone import PictureTone
from trisquare.results.rejected import Rejected

if TYPE_CHECKING:  # it would load OpenCV, which waits until a picture is searched
    from trisquare.detection.annotations.outlines import AnnotatedSquare


@dataclass(slots=True)
class Gathered:
    """What has been found and measured in the photographs so far.

    Attributes
    ----------
    image_size : (int, int)
        Width and height of every photograph, in pixels.
    figures : list of PlaneEdges
        Each with the index of its photograph and the number of its plane, counted over all.
    quads : dict of int to ndarray, shape (4, 2)
        Four points that enclose each plane, by its number.
    rejected : list of Rejected
    warnings : list of str
    pictures : list of Picture
        The pixels of every photograph as the core has them.
    tones : list of PictureTone
        Of every photograph.
    """

    image_size: tuple[int, int] = (0, 0)
    figures: list[PlaneEdges] = field(default_factory=list)
    quads: dict[int, FloatArray] = field(default_factory=dict)
    rejected: list[Rejected] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    pictures: list[_core.Picture] = field(default_factory=list)
    tones: list[PictureTone] = field(default_factory=list)

    def keep(self, chosen: Chosen) -> None:
        """Keep what is chosen of the figures; the others have been rejected."""
        self.figures[:] = chosen.figures
        self.rejected += chosen.rejected
        self.warnings += chosen.warnings

    def add(
        self,
        photograph: Photograph,
        targets: TargetKinds,
        tone: str | float,
        annotated: Sequence[AnnotatedSquare] | None,
    ) -> None:
        """Measure what is in a photograph, or what is `annotated` on it, and remark on it."""
        from trisquare.measurement.measure import measure

        core = _core.Picture(photograph.pixels)
        # In one that was given before nothing is looked for either.
        sought = () if photograph.repeats else annotated
        figures, picture_tone, rejected, quads = measure(
            photograph.pixels, core, targets, tone, sought
        )
        self.pictures.append(core)
        self.tones.append(picture_tone)
        self.rejected += [replace(candidate, image=photograph.index) for candidate in rejected]
        self.warnings += photograph.remarks
        if annotated is not None:
            self.warnings += [f"{photograph.name}: {candidate.reason}" for candidate in rejected]
        if not figures and not photograph.repeats:
            self.warnings.append(f"{photograph.name}: {_nothing(targets, annotated)}")
        planes_before = len(self.quads)
        self.quads.update(enumerate(quads, planes_before))
        self.figures += [_placed(figure, photograph.index, planes_before) for figure in figures]


def gather(
    sources: Sequence[ImageSource],
    targets: TargetKinds,
    tone: Tone,
    outlines: Outlines | None,
    progress: Callable[[int, int], None] | None,
) -> Gathered:
    """Find and measure the targets of several photographs, one after another.

    Parameters
    ----------
    sources : sequence of path or ndarray
    targets : TargetKinds
        What is looked for where nothing is drawn by hand.
    tone, outlines, progress
        As in `calibrate`.

    Raises
    ------
    ImageError
        If a file cannot be read whole.
    TypeError, ValueError
        For bad arguments.
    """
    from trisquare.detection.annotations.load import Annotations

    checked = checked_tone(tone)
    if not sources:
        raise ValueError("no picture given")
    drawings = None if outlines is None else Annotations.read(outlines, sources)
    gathered = Gathered()
    curves: set[str | float] = set()
    for photograph in photographs(sources):
        gathered.image_size = picture_size(photograph.pixels)
        curve = tone_of(photograph.pixels, checked)
        curves.add(curve)
        if len(curves) > 1:
            raise ValueError(
                f"{photograph.name} holds {photograph.pixels.dtype} pixels and those before it do "
                "not, which are usually coded differently: state the tone curve of all (srgb, "
                "linear, auto or a gamma)"
            )
        annotated = None
        if drawings is not None:
            annotated = drawings.on(photograph.index, gathered.image_size)
        gathered.add(photograph, targets, curve, annotated)
        if progress is not None:
            progress(photograph.index + 1, len(sources))
    return gathered


def _nothing(targets: TargetKinds, annotated: Sequence[AnnotatedSquare] | None) -> str:
    """Say what was looked for in a picture in vain."""
    if annotated is None:
        return nothing_found(targets)
    return "none of the outlines is a square" if annotated else "nothing is drawn on it"


def _placed(figure: PlaneEdges, image: int, planes_before: int) -> PlaneEdges:
    plane = None if figure.plane is None else figure.plane + planes_before
    if (figure.image, figure.plane) == (image, plane):  # another copy would be checked anew
        return figure
    return replace(figure, image=image, plane=plane)
