"""Approximation of a lens by another model."""

from __future__ import annotations

from dataclasses import dataclass

from trisquare._support.arrays import Frozen


@dataclass(frozen=True, slots=True, eq=False)
class Approximation(Frozen):
    """A lens that approximates another.

    Parameters
    ----------
    lens : object
        The approximation: a `Camera` for most formats.
    title : str
        Its model.
    rms, worst : float
        Distance between the projections of the two, over the picture, pixels.
    covered : float
        Fraction of the picture in which the two are compared: in the rest, the lens that is
        approximated has no directions.

    Examples
    --------
    >>> nearest = camera.save("panorama.pto", approximate=True)
    >>> nearest.title, nearest.rms > 0
    ('a, b, c with square pixels', True)
    """

    lens: object
    title: str
    rms: float
    worst: float
    covered: float = 1.0

    def __str__(self) -> str:
        summary = f"{self.title}, off by {self.rms:.3g} px rms, {self.worst:.3g} px at worst"
        part = min(100 * self.covered, 99.9)  # a part must not be rounded to 100 %
        where = f" of the {part:.3g} % of the picture that have a direction"
        return summary + (where if self.covered < 1 else "")
