"""Departure of a calibration's residuals from independent noise."""

from __future__ import annotations

from dataclasses import dataclass, field

from trisquare._support.arrays import not_negative
from trisquare._support.records import NUMBER, Kind, Record, member

LIKELIER = 0.5

NUMBERS = Kind(
    lambda values, name: tuple(not_negative(value, name) for value in values),
    lambda members, key: tuple(members.array(key, (None,)).tolist()),
)


@dataclass(frozen=True, slots=True)
class ResidualCorrelation(Record):
    """Departure of the residuals from independent noise, which the covariance allows for.

    Parameters
    ----------
    neighbours : float
        Variance of the mean of many neighbouring samples over that of independent samples; 1 if
        neighbours are not correlated.
    probability : float
        Probability that the samples of a side share an error beyond their noise (paper that is not
        flat, a lens beyond the model).
    displacements : tuple of float
        Root mean square of that error, if there is one, for every plane, in pixels.
    contradiction : float
        Variance of the planes' contradictions over that expected from the straightness of their
        sides; 1 if they do not contradict each other.

    Examples
    --------
    >>> result.coherence.neighbours < 2, result.coherence.sides_err_together
    (True, False)
    """

    neighbours: float = field(metadata=member(NUMBER))
    probability: float = field(metadata=member(NUMBER))
    displacements: tuple[float, ...] = field(metadata=member(NUMBERS, "displacements_px"))
    contradiction: float = field(metadata=member(NUMBER))

    @property
    def sides_err_together(self) -> bool:
        """Whether the samples of a side probably share an error."""
        return self.probability > LIKELIER
