"""How far the residuals of a calibration are from independent noise."""

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
    """How far the residuals are from independent noise; the covariance allows for it.

    Parameters
    ----------
    neighbours : float
        Variance of the mean of many neighbouring samples over what independent ones would have;
        1 where neighbours are not correlated.
    probability : float
        That the samples of a side share an error beyond their noise (paper that is not flat, a
        lens beyond the model).
    displacements : tuple of float
        Root mean square of that error where there is one, for every plane, in pixels.
    contradiction : float
        Variance with which the planes contradict each other over what their sides' own
        straightness lets expect; 1 where they do not.

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
        """Whether the samples of a side share an error, likelier than not."""
        return self.probability > LIKELIER
