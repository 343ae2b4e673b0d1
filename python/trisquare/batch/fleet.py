"""Statistics of many cameras: the spread of each parameter, and outliers."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.batch.requirements import AnyRequirement

FEWEST = 8
"""Minimum number of cameras of a kind for reporting outliers among them."""

CHANCE = 0.05
"""Probability that a fleet without outliers has one reported."""

MAD_EFFICIENCY = 0.37
"""Efficiency of the median absolute deviation for normal values (Rousseeuw and Croux, 1993)."""

GAUSSIAN_MAD = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""

UNCERTAIN = 4.0
"""Standard deviation, relative to the fleet's median one, above which a camera is badly known."""

CURES = {
    "ImageError": "no picture can be read from the file",
    "DetectionError": "no target was found: show sharper, brighter or larger targets, or "
    "name them (--targets)",
    "NotEnoughPlanesError": "too few targets: show three squares tilted in different directions, "
    "or group the photographs of each camera: in a subfolder of the given folder, or by "
    "--camera",
    "NotEnoughDataError": "too little of the targets is visible: let them fill the picture",
    # Several causes are possible, such as parallel targets and a rich lens model: see the text.
    "DegenerateGeometryError": "the photographs do not determine the camera",
    "ConvergenceError": "the targets do not fit one camera: are they flat squares?",
    "TimeLimitError": "the picture takes too long: the file is damaged or hostile, or "
    "--max-seconds is too small",
    "WorkerDiedError": "the process died: the file is damaged or hostile, or there is too little "
    "memory",
    "MemoryError": "the picture is too large: raise --max-memory, or refuse such pictures by "
    "--max-pixels",
}


@dataclass(frozen=True, slots=True)
class Distribution:
    """One parameter over the cameras of a kind (a model and a picture's size).

    Attributes
    ----------
    kind, parameter : str
    values, stds : ndarray, shape (N,)
        Values of all cameras, and their standard deviations, zero if the parameter is fixed.
    median, spread : float
        Median of the fleet, and the standard deviation of the cameras themselves: from the median
        absolute deviation, without the part that the uncertainty explains.
    median_std : float
        Median of the stated standard deviations.
    """

    kind: str
    parameter: str
    values: FloatArray
    stds: FloatArray
    median: float
    spread: float
    median_std: float

    @classmethod
    def of(cls, kind: str, parameter: str, values: FloatArray, stds: FloatArray) -> Distribution:
        """Return the distribution of the values."""
        median, median_std = float(np.median(values)), float(np.median(stds))
        scatter = GAUSSIAN_MAD * float(np.median(np.abs(values - median)))
        spread = float(np.sqrt(max(0.0, scatter**2 - median_std**2)))
        return cls(kind, parameter, values, stds, median, spread, median_std)

    def deviation(self, value: float, std: float) -> float:
        """Return a camera's distance from the median, in standard deviations of that distance.

        A camera with a smaller standard deviation than the median counts as having the median one,
        since the spread of the cameras is not known better. Zero if all of these are zero.
        """
        scale = float(np.hypot(self.spread, max(std, self.median_std)))
        return (value - self.median) / scale if scale > 0.0 else 0.0


@dataclass(slots=True)
class Fleet:
    """Distributions of all parameters, by kind and name."""

    distributions: dict[tuple[str, str], Distribution] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Iterable[Mapping[str, Any]]) -> Fleet:
        """Gather the parameters that at least one camera estimates."""
        values: dict[tuple[str, str], tuple[array[float], array[float]]] = {}
        for record in records:
            if record["status"] != "done":
                continue
            for name, value in record["values"].items():
                parameter_values = values.setdefault(
                    (kind_of(record), name), (array("d"), array("d"))
                )
                parameter_values[0].append(value)
                parameter_values[1].append(record["std"].get(name, 0.0))
        fleet = cls()
        for (kind, name), (numbers, stds) in values.items():
            if any(stds):
                arrays = np.frombuffer(numbers), np.frombuffer(stds)
                fleet.distributions[kind, name] = Distribution.of(kind, name, *arrays)
        return fleet

    def outlying(self, record: Mapping[str, Any]) -> list[str]:
        """Return descriptions of the parameters in which a camera is an outlier of its kind."""
        texts = []
        kind_keys = [key for key in self.distributions if key[0] == kind_of(record)]
        for name, value in record["values"].items():
            distribution = self.distributions.get((kind_of(record), name))
            if distribution is None or len(distribution.values) < FEWEST:
                continue
            deviation = distribution.deviation(value, record["std"].get(name, 0.0))
            allowed = most_by_chance(len(distribution.values), len(kind_keys))
            if abs(deviation) > allowed:
                texts.append(
                    f"{name} {value:.6g} is {deviation:+.1f} standard deviations from the "
                    f"median {distribution.median:.6g}; the limit is {allowed:.1f}"
                )
        return texts

    def uncertain(self, record: Mapping[str, Any]) -> list[str]:
        """Return descriptions of a camera's parameters with a far larger std than its kind's."""
        texts = []
        for name, std in record["std"].items():
            distribution = self.distributions.get((kind_of(record), name))
            if distribution is None or len(distribution.values) < FEWEST:
                continue
            if std > UNCERTAIN * distribution.median_std:
                texts.append(
                    f"the std of {name} is {std:.3g}, but the median "
                    f"is {distribution.median_std:.3g}"
                )
        return texts


def most_by_chance(cameras: int, parameters: int) -> float:
    """Return the largest deviation that a fraction `CHANCE` of such fleets exceeds by chance.

    It is a quantile of Student's distribution, by the approximation of Gaver and Kafadar (A
    retrievable recipe for inverse t, The American Statistician, 1984). Its degrees of freedom are
    those of the median absolute deviation; the added 1 comes from a simulation.
    """
    normal = NormalDist().inv_cdf(1.0 - CHANCE / (2.0 * cameras * parameters))
    freedom = MAD_EFFICIENCY * cameras + 1.0
    stretch = (freedom - 1.5) / (freedom - 1.0) ** 2
    return math.sqrt(freedom * math.expm1(stretch * normal**2))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Judgement on one camera.

    Attributes
    ----------
    status : {"passed", "beyond limits", "failed", "earlier"}
        ``"earlier"`` is a camera of an earlier run that this run was not given; the other members
        are empty then.
    violations : sequence of str
        Violated limits for production.
    outlying : sequence of str
        Parameters in which it is an outlier.
    retake : sequence of str
        Reasons to take its photographs again; empty if there are none.
    failure : str
        Reason of a failure; empty without one. Failures that other photographs would not cure, such
        as a wrong option or a missing file, are given only here.
    """

    status: str
    violations: Sequence[str]
    outlying: Sequence[str]
    retake: Sequence[str]
    failure: str = ""


def verdict(
    record: Mapping[str, Any], fleet: Fleet, requirements: Sequence[AnyRequirement]
) -> Verdict:
    """Judge a camera by its record, its fleet and the limits for production."""
    if record.get("earlier"):
        return Verdict("earlier", (), (), ())
    if record["status"] != "done":
        error = record["error"]
        cure = CURES.get(error["code"])
        reason = f"{error['code']}: {error['text']}"
        if cure is None:
            return Verdict("failed", (), (), (), reason)
        failure = f"{cure} ({reason})"
        return Verdict("failed", (), (), [failure], failure)
    violations = [text for item in requirements if (text := item.violation(record)) is not None]
    severe = [item["text"] for item in record["warnings"] if item["severity"] == "high"]
    status = "beyond limits" if violations else "passed"
    uncertain = fleet.uncertain(record)
    return Verdict(status, violations, fleet.outlying(record), [*severe, *uncertain])


def kind_of(record: Mapping[str, Any]) -> str:
    """Return the properties that cameras must share to be compared."""
    width, height = record["image_size"]
    return f"{record['model']}, {width} x {height}"
