"""The lens models that the data spoke against."""

from __future__ import annotations

from dataclasses import dataclass, field

from trisquare._support.records import NUMBER, REAL, TEXT, Record, check_members, member
from trisquare.camera.lens_models import MODELS


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
