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
class SearchSettings:
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
    is_camera_held : bool
        Whether no parameter of the camera is estimated.
    image_size : (int, int) or None
        Size of the initial camera, if one is given: photographs of another size are not searched,
        since either they are left out or all are refused.
    """

    kinds: TargetKinds
    tone: str | float | None
    drawings: Annotations | None
    lines: bool
    is_camera_held: bool
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
        is_camera_held: bool,
        image_size: tuple[int, int] | None,
    ) -> SearchSettings:
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
        return cls(kinds, checked, drawings, lines, is_camera_held, image_size)

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
        return tone_of(photograph.pixels, self.tone, is_camera_held=self.is_camera_held)

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
    missing_reason : str
        Reason why nothing was measured in it, else empty.
    """

    name: str
    size: tuple[int, int]
    remarks: Iterable[tuple[str, str]]
    annotated: Sequence[AnnotatedSquare] | None
    measured: MeasuredTargets
    lines: list[PlaneEdges]
    missing_reason: str


def measured_photograph(
    load: Callable[[], Photograph], search_settings: SearchSettings, *, is_alone: bool
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
    tone, annotated = search_settings.tone_of(photograph), search_settings.annotated_on(photograph)
    size = picture_size(photograph.pixels)
    is_usable = not photograph.is_repeat and search_settings.image_size in (None, size)
    drawn = annotated if is_usable else ()
    measured = measure(photograph.pixels, search_settings.kinds, tone, drawn)
    if not is_alone:
        measured = measured._replace(search=measured.search.reduced())
    missing_reason, lines = "", []
    if is_usable:
        if not measured.figures:
            missing_reason = _missing_text(measured.search, size, annotated)
        if search_settings.lines:
            from trisquare.straightening.scene_lines import background_lines

            lines = background_lines(photograph.pixels, measured.figures)
    return MeasuredPhotograph(
        photograph.name,
        size,
        photograph.remarks.items(),
        annotated,
        measured,
        lines,
        missing_reason,
    )


def _missing_text(
    search: Search, size: tuple[int, int], annotated: Sequence[AnnotatedSquare] | None
) -> str:
    if annotated is None:
        return nothing_found(search.kinds, size, lack=search.lack_of_contrast())
    return "none of the outlines is a square" if annotated else "nothing is drawn on it"
