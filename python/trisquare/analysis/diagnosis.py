"""What limits each number of a calibration, and what would help.

Every piece of advice is computed: the planes, as they were found, are changed, the standard
deviations predicted before and after, and their ratio applied to the stated ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from trisquare._support.arrays import RebuiltByConstructor
from trisquare.analysis.what_if import Alternative, Planned, alternatives_of, collide, planes_of
from trisquare.errors import TrisquareError

if TYPE_CHECKING:
    from trisquare.results.calibration import Calibration

# Correlations and gains that are worth a word.
STRONG_CORRELATION = 0.8
WORTHWHILE_GAIN = 0.95
MOST_REMEDIES = 2


@dataclass(frozen=True, slots=True, eq=False)
class ParameterDiagnosis(RebuiltByConstructor):
    """How well one parameter is known, why not better, and what would help.

    Parameters
    ----------
    std : float
        Its standard deviation.
    correlation : mapping of str to float
        Its correlation with each other free parameter.
    limits : str
        What limits it, in words.
    remedy : str
        What would help most, with the predicted standard deviation.
    """

    std: float
    correlation: Mapping[str, float]
    limits: str
    remedy: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", MappingProxyType(dict(self.correlation)))

    def __repr__(self) -> str:
        return f"<std {self.std:.3g}: {self.limits}; {self.remedy}>"


class Diagnosis(Mapping[str, ParameterDiagnosis]):
    """The diagnoses of a calibration's free parameters, by name; printed as a table."""

    __slots__ = ("_parameters",)

    def __init__(self, parameters: Mapping[str, ParameterDiagnosis]) -> None:
        self._parameters = dict(parameters)

    def __getitem__(self, name: str) -> ParameterDiagnosis:
        return self._parameters[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __repr__(self) -> str:
        lines = []
        for name, found in self.items():
            lines.append(f"{name}  std {found.std:.2g}: {found.limits}")
            lines.append(f"    {found.remedy}")
        return "\n".join(lines)


def diagnose(calibration: Calibration) -> Diagnosis:
    """Say of every free parameter what limits it and what would help.

    Parameters
    ----------
    calibration : Calibration
        Any, also one that was read from JSON.

    Returns
    -------
    Diagnosis
        By the names in ``calibration.parameters``.
    """
    gains = _gains(calibration)
    return Diagnosis(
        {
            name: _diagnose(calibration, name, [(a, g[name]) for a, g in gains if name in g])
            for name in calibration.parameters
        }
    )


def _gains(calibration: Calibration) -> list[tuple[Alternative, Mapping[str, float]]]:
    """Ratio of the predicted standard deviations after and before each change, by name."""
    fixed = calibration.fixed
    try:
        planes = planes_of(calibration)
        before = Planned(calibration.camera, planes, fixed).std()
    except (TrisquareError, ValueError):
        return []  # what was photographed is no plan that could be compared with
    gains: list[tuple[Alternative, Mapping[str, float]]] = []
    apart = not collide(planes)  # planes of several pictures may well lie over one another
    for alternative in alternatives_of(calibration, planes):
        if apart and collide(alternative.planned.planes):
            continue
        try:
            after = alternative.planned.std()
        except (TrisquareError, ValueError):
            continue  # it would leave the picture
        gains.append((alternative, {name: after[name] / before[name] for name in after}))
    return gains


def _diagnose(
    calibration: Calibration, name: str, gains: list[tuple[Alternative, float]]
) -> ParameterDiagnosis:
    index = calibration.parameters.index(name)
    covariance = calibration.covariance
    spread = np.sqrt(np.diag(covariance))
    scale = spread[index] * spread
    row = np.divide(covariance[index], scale, out=np.zeros_like(scale), where=scale > 0)
    correlation = {
        other: float(np.clip(row[i], -1.0, 1.0))
        for i, other in enumerate(calibration.parameters)
        if i != index
    }
    ranked = sorted(gains, key=lambda gain: gain[1])
    helpful = [(a, gain) for a, gain in ranked if gain < WORTHWHILE_GAIN]
    std = calibration.std[name]
    return ParameterDiagnosis(
        std=std,
        correlation=correlation,
        limits=_limits(calibration, correlation, helpful),
        remedy=_remedy(name, std, helpful),
    )


def _limits(
    calibration: Calibration,
    correlation: Mapping[str, float],
    helpful: list[tuple[Alternative, float]],
) -> str:
    parts = []
    physical = [alternative.lack for alternative, _ in helpful if alternative.lack]
    if physical:
        parts.append(physical[0])
    strongest = max(correlation, key=lambda other: abs(correlation[other]), default=None)
    if strongest is not None and abs(correlation[strongest]) > STRONG_CORRELATION:
        value = correlation[strongest]
        parts.append(f"it is hard to tell from {strongest} (correlation {value:+.2f})")
    samples = sum(plane.samples for plane in calibration.planes)
    parts.append(f"noise of {calibration.rms:.2g} px in {samples} edge samples")
    return ", and ".join(parts[:2])


def _remedy(name: str, std: float, helpful: list[tuple[Alternative, float]]) -> str:
    if not helpful:
        return "no single change of the set-up would help much; less noise would"
    unit = " px" if name in ("fx", "fy", "cx", "cy") else ""
    best = [
        f"{alternative.change} would bring it from {std:.2g} to {std * gain:.2g}{unit}"
        for alternative, gain in helpful[:MOST_REMEDIES]
    ]
    return "; ".join(best)
