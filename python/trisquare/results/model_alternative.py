"""The lens models that were not chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from trisquare._support.records import NUMBER, REAL, TEXT, Record, check_members, member
from trisquare.camera.lens_models import MODELS

WORTH_A_MENTION = 1.0
"""Natural logarithm of odds below which evidence is "not worth more than a bare mention" (R. Kass &
A. Raftery, *J. American Statistical Association* 90 (1995) 773-795)."""

FAR_BEHIND = 100.0
"""Natural logarithm of odds against a model beyond which it is not stated: it only means that the
model is wrong, and grows with the number of samples."""


@dataclass(frozen=True, slots=True)
class ModelAlternative(Record):
    """A lens model that ``model="auto"`` considered and did not choose.

    Parameters
    ----------
    model : str
        Its name, as in `Camera`.
    log_evidence : float
        Natural logarithm of its odds against the chosen model, never positive: -3 is one to
        twenty.
    rms : float
        Root mean square residual of the edge samples with it, in pixels.

    Examples
    --------
    >>> chosen = ts.calibrate("photo.jpg", model="auto")
    >>> chosen.camera.model, "none" in [other.model for other in chosen.alternatives]
    ('radial2', True)
    """

    model: str = field(metadata=member(TEXT))
    log_evidence: float = field(metadata=member(REAL))
    rms: float = field(metadata=member(NUMBER, "rms_px"))

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ValueError(f"model must be one of {MODELS}, not {self.model!r}")
        check_members(self)
        if self.log_evidence > 0:
            raise ValueError(f"log_evidence must not be positive, but is {self.log_evidence}")


def evidence_text(others: Sequence[ModelAlternative]) -> str:
    """Return the evidence of the other models relative to the chosen one; empty without any."""
    if not others:
        return ""
    odds = ", ".join(f"{other.model} {_odds_text(other.log_evidence)}" for other in others)
    equals = [other.model for other in others if other.log_evidence > -WORTH_A_MENTION]
    models = "the model" if len(equals) == 1 else "the models"
    tie = f"; {models} {' and '.join(equals)} would do as well" if equals else ""
    return f"by evidence (natural log odds of the other models against it: {odds}{tie})"


def _odds_text(log_odds: float) -> str:
    if log_odds < -FAR_BEHIND:
        return f"below -{FAR_BEHIND:.0f}"
    return f"{round(log_odds, 1) + 0.0:.1f}"  # no "-0.0"
