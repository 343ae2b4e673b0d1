"""A lens that stands in for another."""

from __future__ import annotations

from dataclasses import dataclass

from trisquare._support.arrays import Frozen


@dataclass(frozen=True, slots=True, eq=False)
class Approximation(Frozen):
    """A lens in place of another.

    Parameters
    ----------
    lens : object
        What stands in: a `Camera` for most formats.
    title : str
        Its model.
    rms, worst : float
        How far apart the two project, over the picture, pixels.
    covered : float
        The part of the picture that this is about: beyond it, the lens that is replaced has no
        directions itself.

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
        said = f"{self.title}, off by {self.rms:.3g} px rms, {self.worst:.3g} px at worst"
        part = min(100 * self.covered, 99.9)  # a part is not rounded to the whole
        where = f" of the {part:.3g} % of the picture that have a direction"
        return said + (where if self.covered < 1 else "")
