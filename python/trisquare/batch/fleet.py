"""What many cameras are together: the spread of each number, and those that stand out."""

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
"""Cameras of a kind whose spread is known well enough to call one of them an outlier."""

CHANCE = 0.05
"""Of fleets in which nobody stands out, those that have an outlier all the same."""

MAD_EFFICIENCY = 0.37
"""Of the median absolute deviation of normal values (Rousseeuw and Croux, 1993)."""

GAUSSIAN_MAD = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""

UNCERTAIN = 4.0
"""Times the fleet's median standard deviation from which a camera is badly known."""

CURES = {
    "ImageError": "no picture can be read from the file",
    "DetectionError": "no target was found: sharper, brighter, larger targets, or --targets",
    "NotEnoughPlanesError": "too few targets: show three squares that are tilted differently, or "
    "take the photographs of one camera together, by a folder below the one that is named or by "
    "--camera",
    "NotEnoughDataError": "too little of the targets is seen: let them fill the picture",
    # Of several causes, parallel targets and a rich lens model among them: the error's text tells.
    "DegenerateGeometryError": "the photographs do not determine the camera",
    "ConvergenceError": "the targets do not fit one camera: are they flat squares?",
    "TimeLimitError": "the picture takes too long: a hostile file, or --max-seconds is too little",
    "WorkerDiedError": "the process died of it: a hostile file, or too little memory",
    "MemoryError": "the picture is too large: raise --max-memory, or refuse it by --max-pixels",
}


@dataclass(frozen=True, slots=True)
class Distribution:
    """One parameter over the cameras of a kind (a model and a picture's size).

    Attributes
    ----------
    kind, parameter : str
    values, stds : ndarray, shape (N,)
        Of every camera, the latter zero where it is held.
    median, spread : float
        The fleet's, the latter the cameras' own standard deviation: by the median absolute
        deviation, less what their uncertainty explains.
    median_std : float
        The median of what the cameras state.
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
        """Sum up the values."""
        median, median_std = float(np.median(values)), float(np.median(stds))
        scatter = GAUSSIAN_MAD * float(np.median(np.abs(values - median)))
        spread = float(np.sqrt(max(0.0, scatter**2 - median_std**2)))
        return cls(kind, parameter, values, stds, median, spread, median_std)

    def deviation(self, value: float, std: float) -> float:
        """Return how far a camera is from the median, in standard deviations of that distance.

        One that is known better than most counts as known like the median one: how far cameras
        really differ is known no better. Zero where nothing is known.
        """
        scale = float(np.hypot(self.spread, max(std, self.median_std)))
        return (value - self.median) / scale if scale > 0.0 else 0.0


@dataclass(slots=True)
class Fleet:
    """The distributions of all parameters, by kind and name."""

    distributions: dict[tuple[str, str], Distribution] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Iterable[Mapping[str, Any]]) -> Fleet:
        """Gather the parameters that at least one camera estimates."""
        values: dict[tuple[str, str], tuple[array[float], array[float]]] = {}
        for record in records:
            if record["status"] != "done":
                continue
            for name, value in record["values"].items():
                own = values.setdefault((kind_of(record), name), (array("d"), array("d")))
                own[0].append(value)
                own[1].append(record["std"].get(name, 0.0))
        fleet = cls()
        for (kind, name), (found, stds) in values.items():
            if any(stds):
                arrays = np.frombuffer(found), np.frombuffer(stds)
                fleet.distributions[kind, name] = Distribution.of(kind, name, *arrays)
        return fleet

    def outlying(self, record: Mapping[str, Any]) -> list[str]:
        """Say in which parameters a camera stands out of its kind."""
        found = []
        of_kind = [key for key in self.distributions if key[0] == kind_of(record)]
        for name, value in record["values"].items():
            own = self.distributions.get((kind_of(record), name))
            if own is None or len(own.values) < FEWEST:
                continue
            deviation = own.deviation(value, record["std"].get(name, 0.0))
            allowed = most_by_chance(len(own.values), len(of_kind))
            if abs(deviation) > allowed:
                found.append(
                    f"{name} {value:.6g} is {deviation:+.1f} standard deviations from the "
                    f"median {own.median:.6g}: more than {allowed:.1f}"
                )
        return found

    def uncertain(self, record: Mapping[str, Any]) -> list[str]:
        """Say which parameters of a camera are known much less well than those of its kind."""
        found = []
        for name, std in record["std"].items():
            own = self.distributions.get((kind_of(record), name))
            if own is None or len(own.values) < FEWEST:
                continue
            if std > UNCERTAIN * own.median_std:
                found.append(f"std of {name} {std:.3g}, the median is {own.median_std:.3g}")
        return found


def most_by_chance(cameras: int, parameters: int) -> float:
    """Return the largest deviation that `CHANCE` of fleets of so many cameras have by chance.

    That is a quantile of Student's distribution, by the approximation of Gaver and Kafadar (A
    retrievable recipe for inverse t, The American Statistician, 1984). Its degrees of freedom are
    those of the median absolute deviation; the 1 beside them is a simulation's.
    """
    normal = NormalDist().inv_cdf(1.0 - CHANCE / (2.0 * cameras * parameters))
    freedom = MAD_EFFICIENCY * cameras + 1.0
    stretch = (freedom - 1.5) / (freedom - 1.0) ** 2
    return math.sqrt(freedom * math.expm1(stretch * normal**2))


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is to be said of one camera.

    Attributes
    ----------
    status : {"passed", "beyond limits", "failed", "earlier"}
        The last of a camera that an earlier run did and this one was not given: of it nothing
        else is said.
    violations : sequence of str
        Of the limits for production.
    outlying : sequence of str
    retake : sequence of str
        Why its photographs should be taken again; empty if they need not.
    failure : str
        Why it failed; empty if it did not. What other photographs would not cure, as a wrong
        option or a missing file, stands here alone.
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
    violations = [text for own in requirements if (text := own.violation(record)) is not None]
    severe = [own["text"] for own in record["warnings"] if own["severity"] == "high"]
    status = "beyond limits" if violations else "passed"
    uncertain = fleet.uncertain(record)
    return Verdict(status, violations, fleet.outlying(record), [*severe, *uncertain])


def kind_of(record: Mapping[str, Any]) -> str:
    """Return what cameras must share to be compared."""
    width, height = record["image_size"]
    return f"{record['model']}, {width} x {height}"
