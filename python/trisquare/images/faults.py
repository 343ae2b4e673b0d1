"""Faults of pictures that the profiles of their edges show."""

from __future__ import annotations

from dataclasses import dataclass, fields

import trisquare._core as _core

MAX_CLIPPED_SHARE = 0.1
"""Fraction of sides with clipped light above which a warning is given."""


@dataclass(frozen=True, slots=True)
class PictureFaults:
    """The faults of one picture.

    Attributes
    ----------
    row_shift : (float, float) or None
        Displacement of odd rows relative to the even ones, which alone are then measured.
    colour_shift : (float, float) or None
        Displacements of blue and red outward in the corners, pixels; then green alone is
        measured, unless the targets hardly show in it.
    is_green : bool
        Whether green alone was measured.
    clipped : float
        Fraction of the sides whose light is clipped.
    has_two_levels : bool
        Whether all pixels are black or white.
    motion : (float, float) or None
        Length of the camera's motion, pixels, and its direction, degrees.
    blur : float
        Median of the sides' blurs, one standard deviation, pixels.
    pattern : float or None
        Amplitude of a fine pattern over the picture, as a fraction of the targets' contrast.
    side_error : float
        Standard deviation of each side's position that is due to the faults, pixels.
    line_error : float
        The same for a board's lines, along which light and dark alternate.
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
    def of(cls, core_faults: _core.PictureFaults) -> PictureFaults:
        """Convert the faults that the core found in a picture."""
        return cls(**{member.name: getattr(core_faults, member.name) for member in fields(cls)})

    @property
    def is_shifted(self) -> bool:
        """Whether they explain that the profiles fit no tone curve."""
        return self.clipped > MAX_CLIPPED_SHARE or self.has_two_levels
