"""Measurement of one photograph of a calibration, independent of the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from trisquare.detection.kinds import TargetKinds, nothing_found
from trisquare.edges import PlaneEdges
from trisquare.images.photographs import Photograph
from trisquare.images.pixels import Outlines, Tone, checked_tone, picture_size, tone_of

if TYPE_CHECKING:  # the import loads OpenCV, which is delayed until a picture is searched
    from trisquare.detection.annotations.load import Annotations
    from trisquare.detection.annotations.outlines import AnnotatedSquare
    from trisquare.images.pixels import ImageSource
    from trisquare.measurement.find import Search
    from trisquare.measurement.measure import MeasuredTargets


@dataclass(frozen=True, slots=True, eq=False)
class Sought:
    """What is searched for in every photograph, and how.

    Attributes
    ----------
    kinds : TargetKinds
    tone : str, float or None
        As in `calibrate`.
    drawings : Annotations or None
        Outlines drawn by hand, in place of a search.
    lines : bool
        Whether lines of the scene are also found.
    camera_held : bool
        Whether no parameter of the camera is estimated.
    image_size : (int, int) or None
        Size of the initial camera, if one is given: photographs of another size are not searched,
        since either they are left out or all are refused.
    """

    kinds: TargetKinds
    tone: str | float | None
    drawings: Annotations | None
    lines: bool
    camera_held: bool
    image_size: tuple[int, int] | None

    @classmethod
    def check(
        cls,
        kinds: TargetKinds,
        tone: Tone,
        outlines: Outlines | None,
        sources: Sequence[ImageSource],
        *,
        lines: bool,
        camera_held: bool,
        image_size: tuple[int, int] | None,
    ) -> Sought:
        """Check the arguments, and read the outlines drawn on the `sources`.

        Raises
        ------
        TypeError, ValueError
            For bad arguments.
        """
        from trisquare.detection.annotations.load import Annotations

        checked = checked_tone(tone)
        if not sources:
            raise ValueError("no picture given")
        drawings = None if outlines is None else Annotations.read(outlines, sources)
        return cls(kinds, checked, drawings, lines, camera_held, image_size)

    def tone_of(self, photograph: Photograph) -> str | float:
        """Return the tone curve of a photograph.

        Raises
        ------
        ValueError
            If it is not stated, and the pictures before it have another pixel type.
        """
        if self.tone is None and photograph.other_type is not None:
            raise ValueError(
                f"{photograph.name} has {photograph.other_type} pixels, unlike the pictures "
                "before it, and their tone curves probably differ: give one tone curve for all "
                "(srgb, linear, auto or a gamma)"
            )
        return tone_of(photograph.pixels, self.tone, camera_held=self.camera_held)

    def annotated_on(self, photograph: Photograph) -> Sequence[AnnotatedSquare] | None:
        """Return the outlines drawn on a photograph; None if there are none on any photograph.

        Raises
        ------
        ValueError
            If they were drawn on a picture of another size, or reach outside the picture.
        """
        if self.drawings is None:
            return None
        return self.drawings.on(photograph.index, picture_size(photograph.pixels))


class MeasuredPhotograph(NamedTuple):
    """Measurements and remarks of a photograph, without its pixels.

    Attributes
    ----------
    name : str
    size : (int, int)
        Width and height in pixels.
    remarks : iterable of (str, str)
        Codes and texts of remarks for the user.
    annotated : sequence of AnnotatedSquare or None
        Outlines drawn on it; None if there are none on any photograph.
    measured : MeasuredTargets
    lines : list of PlaneEdges
        Lines of the scene.
    nothing : str
        Reason why nothing was measured in it, else empty.
    """

    name: str
    size: tuple[int, int]
    remarks: Iterable[tuple[str, str]]
    annotated: Sequence[AnnotatedSquare] | None
    measured: MeasuredTargets
    lines: list[PlaneEdges]
    nothing: str


def measured_photograph(
    load: Callable[[], Photograph], sought: Sought, *, is_alone: bool
) -> MeasuredPhotograph:
    """Load a photograph and measure its targets, or the outlines drawn on it.

    If it `is_alone`, its search stays in memory as it is: reducing it takes time.

    Raises
    ------
    ImageError
        If it cannot be read completely.
    TypeError, ValueError
        If it is not a picture, or does not match the others or the outlines drawn on it.
    """
    from trisquare.measurement.measure import measure

    photograph = load()
    tone, annotated = sought.tone_of(photograph), sought.annotated_on(photograph)
    size = picture_size(photograph.pixels)
    is_of_use = not photograph.repeats and sought.image_size in (None, size)
    looked_at = annotated if is_of_use else ()
    measured = measure(photograph.pixels, sought.kinds, tone, looked_at)
    if not is_alone:
        measured = measured._replace(search=measured.search.reduced())
    nothing, lines = "", []
    if is_of_use:
        if not measured.figures:
            nothing = _nothing_in(measured.search, size, annotated)
        if sought.lines:
            from trisquare.straightening.scene_lines import lines_beside

            lines = lines_beside(photograph.pixels, measured.figures)
    return MeasuredPhotograph(
        photograph.name,
        size,
        photograph.remarks.items(),
        annotated,
        measured,
        lines,
        nothing,
    )


def _nothing_in(
    search: Search, size: tuple[int, int], annotated: Sequence[AnnotatedSquare] | None
) -> str:
    if annotated is None:
        return nothing_found(search.kinds, size, lack=search.lack_of_contrast())
    return "none of the outlines is a square" if annotated else "nothing is drawn on it"
