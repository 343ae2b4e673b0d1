"""Faults of pictures that their edges' profiles show."""

from __future__ import annotations

from dataclasses import dataclass, fields

import trisquare._core as _core

CLIPPED = 0.1
"""Share of the sides whose light is clipped from which a warning says so."""


@dataclass(frozen=True, slots=True)
class PictureFaults:
    """The faults of one picture.

    Attributes
    ----------
    row_shift : (float, float) or None
        How far odd rows are displaced against the even ones, which alone are then measured.
    colour_shift : (float, float) or None
        How far blue and red are displaced outward in the corners, pixels; then green alone is
        measured, unless the targets hardly show in it.
    is_green : bool
        Whether that was done.
    clipped : float
        Share of the sides whose light is clipped.
    has_two_levels : bool
        Whether all pixels are black or white.
    motion : (float, float) or None
        Length of the camera's motion, pixels, and its direction, degrees.
    blur : float
        The middle one of the sides' blurs, one standard deviation, pixels.
    pattern : float or None
        Amplitude of a fine pattern over the picture, in parts of the targets' contrast.
    side_error : float
        One standard deviation of what they leave unknown of each side's place, pixels.
    line_error : float
        The same of a board's lines, along which light and dark alternate.
    """

    row_shift: tuple[float, float] | None = None
    colour_shift: tuple[float, float] | None = None
    is_green: bool = False
    clipped: float = 0.0
    has_two_levels: bool = False
    motion: tuple[float, float] | None = None
    blur: float = 0.0
    pattern: float | None = None
    side_error: float = 0.0
    line_error: float = 0.0

    @classmethod
    def of(cls, found: _core.PictureFaults) -> PictureFaults:
        """Return what the edges of a picture have shown."""
        return cls(**{own.name: getattr(found, own.name) for own in fields(cls)})

    @property
    def is_shifted(self) -> bool:
        """Whether they explain that the profiles fit no tone curve."""
        return self.clipped > CLIPPED or self.has_two_levels
