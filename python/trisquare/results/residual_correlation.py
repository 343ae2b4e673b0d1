"""How far the residuals of a calibration are from independent noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trisquare._support.arrays import RebuiltByConstructor, not_negative
from trisquare._support.json_members import JsonFields

LIKELIER = 0.5


@dataclass(frozen=True, slots=True)
class ResidualCorrelation(RebuiltByConstructor):
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
    """

    neighbours: float
    probability: float
    displacements: tuple[float, ...]
    contradiction: float

    def __post_init__(self) -> None:
        for name in ("neighbours", "probability", "contradiction"):
            object.__setattr__(self, name, not_negative(getattr(self, name), name))
        displacements = tuple(not_negative(d, "displacements") for d in self.displacements)
        object.__setattr__(self, "displacements", displacements)

    @property
    def sides_err_together(self) -> bool:
        """Whether the samples of a side share an error, likelier than not."""
        return self.probability > LIKELIER


def residual_correlation_members(coherence: ResidualCorrelation) -> dict[str, Any]:
    """Return the ``coherence`` object of the JSON format."""
    return {
        "neighbours": coherence.neighbours,
        "probability": coherence.probability,
        "displacements_px": list(coherence.displacements),
        "contradiction": coherence.contradiction,
    }


def residual_correlation_from_members(members: JsonFields) -> ResidualCorrelation:
    """Read the ``coherence`` object of the JSON format."""
    return ResidualCorrelation(
        neighbours=members.number("neighbours"),
        probability=members.number("probability"),
        displacements=tuple(members.array("displacements_px", (None,)).tolist()),
        contradiction=members.number("contradiction"),
    )
