"""Limits of the precision of each parameter, and changes that would improve it.

All advice is computed: the planes are changed, the standard deviations are predicted before and
after the change, and their ratio is applied to the stated ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from trisquare._support.arrays import ReadOnlyDict, RebuiltByConstructor
from trisquare._support.number_text import plus_minus
from trisquare.analysis.what_if import WhatIf, contradicted_aspect, gains
from trisquare.results.calibration import Calibration

# Thresholds of correlations and gains that are reported.
STRONG_CORRELATION = 0.8
WORTHWHILE_GAIN = 0.95
MAX_REMEDIES = 2

UNCHECKED = "targets_unchecked"

CAUSES = {
    "lens_beyond_model": "the lens model does not fit the lens",
    "relation_contradicted": "planes contradict their stated relation",
    "planes_contradict": "the planes contradict each other",
    "pixels_not_square": "the estimated pixels are not square",
    "tone_contradicted": "the tone curve is another than stated",
    "plane_disagrees": "a plane disagrees with the rest",
    "planes_vary": "the pictures disagree",
    "plane_stretched": "the targets are stretched",
    "correlated_residuals": "the samples of a side have a common error",
    UNCHECKED: "the targets cannot be checked",
    "no_tone_curve": "the edge profiles fit no tone curve",
}
"""What limits every parameter in addition to noise, by the code of the warning about it."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterDiagnosis(RebuiltByConstructor):
    """Precision of one parameter, what limits it, and what would improve it.

    Parameters
    ----------
    std : float
        Its standard deviation.
    correlation : mapping of str to float
        Its correlation with each other free parameter.
    limits : str
        Description of what limits it.
    remedy : str
        The most effective improvements, with the predicted standard deviations.
    """

    std: float
    correlation: Mapping[str, float]
    limits: str
    remedy: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", ReadOnlyDict(self.correlation))

    def __repr__(self) -> str:
        return f"<std {self.std:.3g}: {self.limits}; {self.remedy}>"


class Diagnosis(Mapping[str, ParameterDiagnosis]):
    """Diagnoses of a calibration's free parameters, by name; printed as a table.

    Examples
    --------
    >>> for name, own in ts.diagnose(result).items():
    ...     print(name, f"{own.std:.2g}")
    fx 0.077
    fy 0.083
    cx 0.047
    cy 0.085
    k1 3.9e-05
    k2 3.8e-05
    """

    __slots__ = ("_parameters",)

    def __init__(self, parameters: Mapping[str, ParameterDiagnosis]) -> None:
        self._parameters = dict(parameters)

    def __getitem__(self, name: str) -> ParameterDiagnosis:
        return self._parameters[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def members(self) -> dict[str, dict[str, str]]:
        """Return the limits and remedies of all parameters as a JSON object.

        Examples
        --------
        >>> sorted(ts.diagnose(result).members()["fx"])
        ['limits', 'remedy']
        """
        return {
            name: {"limits": diagnosis.limits, "remedy": diagnosis.remedy}
            for name, diagnosis in self.items()
        }

    def __repr__(self) -> str:
        lines = []
        for name, diagnosis in self.items():
            lines.append(f"{name}  std {diagnosis.std:.2g}: {diagnosis.limits}")
            lines.append(f"    {diagnosis.remedy}")
        return "\n".join(lines)


def diagnose(calibration: Calibration) -> Diagnosis:
    """Diagnose for every free parameter what limits its precision and what would improve it.

    Parameters
    ----------
    calibration : Calibration
        Any calibration, also one that was read from JSON.

    Returns
    -------
    Diagnosis
        Diagnoses by the names in ``calibration.parameters``.

    Raises
    ------
    TypeError
        If it is not a calibration: a `Camera` alone has no uncertainty.

    Examples
    --------
    >>> diagnosis = ts.diagnose(result)
    >>> print(diagnosis["fx"].limits)
    it is strongly correlated with fy (+0.99), and noise of 0.012 px in 1554 edge samples
    """
    if not isinstance(calibration, Calibration):
        raise TypeError(f"calibration must be a Calibration, not {type(calibration).__name__}")
    ratios = gains(calibration)
    names = calibration.parameters
    return Diagnosis({name: _diagnose(calibration, name, ratios) for name in names})


def _diagnose(
    calibration: Calibration, name: str, ratios: list[tuple[WhatIf, Mapping[str, float]]]
) -> ParameterDiagnosis:
    names, std = calibration.parameters, calibration.std[name]
    index = names.index(name)
    spread = np.sqrt(np.diag(calibration.covariance))
    scale = spread[index] * spread
    row = np.divide(calibration.covariance[index], scale, out=np.zeros_like(scale), where=scale > 0)
    values = dict(zip(names, np.clip(row, -1.0, 1.0).tolist(), strict=True))
    correlation = {parameter: value for parameter, value in values.items() if parameter != name}
    parameter_gains = [(ratio[name], what_if) for what_if, ratio in ratios if name in ratio]
    helpful = sorted(
        (gain for gain in parameter_gains if gain[0] < WORTHWHILE_GAIN), key=itemgetter(0)
    )
    cause = next((w.code for w in calibration.warnings if w.code in CAUSES), None)
    coherence = calibration.coherence
    displacement = None
    if cause is None and coherence is not None and coherence.sides_err_together:
        displacement = max(coherence.displacements, default=0.0)
    if cause is not None:
        limits = [CAUSES[cause]]
    elif displacement is not None:
        limits = [f"{CAUSES['correlated_residuals']}, by {displacement:.2g} px"]
    else:
        limits = []
    limits += [what_if.lack for _, what_if in helpful if what_if.lack][:1]
    strongest = max(correlation, key=lambda parameter: abs(correlation[parameter]), default=name)
    if abs(value := correlation.get(strongest, 0.0)) > STRONG_CORRELATION:
        limits.append(f"it is strongly correlated with {strongest} ({value:+.2f})")
    samples = sum(plane.samples for plane in calibration.planes if plane.is_used)
    limits.append(f"noise of {calibration.rms:.2g} px in {samples} edge samples")
    unit = " px" if name in ("fx", "fy", "cx", "cy", "skew") else ""
    shown = helpful[:MAX_REMEDIES]
    if "aspect" not in calibration.fixed:
        shown += [gain for gain in helpful[MAX_REMEDIES:] if "aspect" in gain[1].fixed]
    remedies = [
        f"{what_if.change} would reduce it from {std:.2g} to {std * ratio:.2g}{unit}"
        for ratio, what_if in shown
    ]
    improvement = "lower noise" if displacement is None else "flatter targets"
    fallback = f"no single change of the set-up would help much; {improvement} would"
    if cause is not None:
        # The predictions are for noise alone, which is not what limits the precision here.
        remedies = [f"first resolve the warning {cause}", *remedies[:1]]
    remedies = remedies or [fallback]
    contradicted = contradicted_aspect(calibration)
    if contradicted is not None and cause != UNCHECKED and name in ("fx", "fy"):
        ratio = plus_minus(*contradicted)
        remedies.append(f"fixing the aspect at 1 is no remedy: fy / fx is {ratio}")
    return ParameterDiagnosis(std, correlation, ", and ".join(limits[:2]), "; ".join(remedies))
