"""The distortion models that the data spoke against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trisquare._support.arrays import RebuiltByConstructor, not_negative, real_number
from trisquare._support.json_members import JsonFields
from trisquare.camera.camera import MODELS


@dataclass(frozen=True, slots=True)
class ModelAlternative(RebuiltByConstructor):
    """A distortion model that ``model="auto"`` considered and did not choose.

    Parameters
    ----------
    model : {"none", "radial1", "radial2", "radial3", "brown"}
        Its name.
    log_evidence : float
        Natural logarithm of its odds against the chosen model, never positive: -3 is one to
        twenty.
    rms : float
        Root mean square residual of the edge samples with it, in pixels.
    """

    model: str
    log_evidence: float
    rms: float

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ValueError(f"model must be one of {MODELS}, not {self.model!r}")
        log_evidence = real_number(self.log_evidence, "log_evidence")
        if log_evidence > 0:
            raise ValueError(f"log_evidence must not be positive, but is {log_evidence}")
        object.__setattr__(self, "log_evidence", log_evidence)
        object.__setattr__(self, "rms", not_negative(self.rms, "rms"))


def alternative_members(alternative: ModelAlternative) -> dict[str, Any]:
    """Return one of the ``alternatives`` of the JSON format."""
    return {
        "model": alternative.model,
        "log_evidence": alternative.log_evidence,
        "rms_px": alternative.rms,
    }


def alternative_from_members(members: JsonFields) -> ModelAlternative:
    """Read one of the ``alternatives`` of the JSON format."""
    return ModelAlternative(
        members.text("model"), members.number("log_evidence"), members.number("rms_px")
    )
