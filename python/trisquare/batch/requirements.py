"""Limits for production, which a camera must meet to pass."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from trisquare._support.arrays import real_number
from trisquare._support.paths import naming, read_text
from trisquare._support.suggestions import unknown
from trisquare._support.writing import PathLike
from trisquare.camera.lens_models import COEFFICIENTS
from trisquare.results.calibration_warning import SEVERITIES

PARAMETERS = tuple(
    dict.fromkeys(
        ["fx", "fy", "cx", "cy", *(name for each in COEFFICIENTS.values() for name in each), "skew"]
    )
)
OTHERS = ("rms_px", "noise_scale", "planes")
KEYS = ("nominal", "within", "least", "most")

WARNINGS = "warnings"
NO_WARNING = "none"
SEVERITIES_ALLOWED = (*SEVERITIES, NO_WARNING)

MAX_CHARACTERS = 10_000
"""Maximum length of a file. Limits for all numbers take a fifth of it; the time and memory of a key
with many parts grow with the square of its length."""

PER_CENT = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*%\s*")


@dataclass(frozen=True, slots=True)
class Requirement:
    """Bounds of one number of a camera, each of which may be None.

    Attributes
    ----------
    name : str
        Name of the number, as in `quantity`.
    least, most : float or None
    unit : {"", " %"}
        Unit of the bounds: per cent of the parameter, for a standard deviation.
    """

    name: str
    least: float | None
    most: float | None
    unit: str = ""

    def violation(self, record: Mapping[str, Any]) -> str | None:
        """Return how a camera's record violates the bounds; None if it does not."""
        value = quantity(record, self.name)
        if value is not None and self.unit:
            parameter = quantity(record, self.name.removeprefix("std."))
            value = 100.0 * value / abs(parameter) if parameter else math.inf
        if value is None:
            return (
                f"{self.name}: the model {record['model']} does not have this parameter, or it is "
                "fixed"
            )
        for bound, is_beyond, word in (
            (self.least, self.least is not None and value < self.least, "below"),
            (self.most, self.most is not None and value > self.most, "above"),
        ):
            if is_beyond:
                return f"{self.name} {value:.6g}{self.unit} is {word} {bound:.6g}{self.unit}"
        return None

    @property
    def bounds(self) -> tuple[str, str]:
        """The lower and upper bound as texts, empty if there is none."""
        least, most = (
            "" if bound is None else f"{bound:.6g}{self.unit}" for bound in (self.least, self.most)
        )
        return least, most

    def __str__(self) -> str:
        least, most = self.bounds
        if not most:
            return f"{self.name} >= {least}"
        return " <= ".join(filter(None, (least, self.name, most)))


@dataclass(frozen=True, slots=True)
class WarningRequirement:
    """The highest severity that a camera's warnings may have, or ``"none"``."""

    most: str
    name: str = WARNINGS

    def violation(self, record: Mapping[str, Any]) -> str | None:
        """Return the warnings that are more severe; None if there are none."""
        allowed = SEVERITIES_ALLOWED.index(self.most)
        violations = dict.fromkeys(
            f"{warning['code']} is {warning['severity']}"
            for warning in record["warnings"]
            if SEVERITIES_ALLOWED.index(warning["severity"]) < allowed
        )
        return f"warnings: {', '.join(violations)}, above {self.most}" if violations else None

    @property
    def bounds(self) -> tuple[str, str]:
        """Bounds as in `Requirement`."""
        return "", self.most

    def __str__(self) -> str:
        return f"{self.name} <= {self.most}"


AnyRequirement = Requirement | WarningRequirement


def quantity(record: Mapping[str, Any], name: str) -> float | None:
    """Return a number of a calibrated camera's record by its name: fx, std.fx, rms_px, ..."""
    kind, _, parameter = name.rpartition(".")
    numbers = record if name in OTHERS else record["std" if kind else "values"]
    value = numbers.get(parameter)
    return None if value is None else float(value)


def read_requirements(path: PathLike) -> list[AnyRequirement]:
    """Read limits for production from a TOML file.

    There is a table for each number: ``[fx]``, ``[std.cx]``, ``[rms_px]``, ``[noise_scale]``,
    ``[planes]``, with ``least`` and ``most``, or ``nominal`` and ``within`` (a number, or
    ``"1 %"``). For a standard deviation ``least`` and ``most`` may be in per cent of its
    parameter. ``[warnings]`` has the highest severity allowed, ``most = "medium"``.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not TOML, too long, or has a number that no camera has; the message begins with
        the file's name.
    """
    try:
        import tomllib
    except ImportError:  # Python 3.10
        import tomli as tomllib  # type: ignore[import-not-found, no-redef, unused-ignore]
    text = read_text(path)
    with naming(path):
        if len(text) > MAX_CHARACTERS:
            raise ValueError(f"a file of limits may have at most {MAX_CHARACTERS} characters")
        try:
            document = tomllib.loads(text)
        except RecursionError as error:
            raise ValueError("the TOML text is nested too deeply") from error
        requirements = [_requirement(name, table) for name, table in _tables(document)]
        if not requirements:
            raise ValueError("the file contains no limit")
    return requirements


def _tables(document: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, table in document.items():
        if name == "std" and isinstance(table, dict):
            for parameter, bounds in table.items():
                if parameter not in PARAMETERS:
                    raise unknown("parameter", parameter, PARAMETERS)
                yield f"std.{parameter}", bounds
        elif name in (*PARAMETERS, *OTHERS, WARNINGS):
            yield name, table
        else:
            raise unknown(
                "parameter",
                name,
                (*PARAMETERS, *OTHERS, WARNINGS),
                f"a parameter, std.PARAMETER, {', '.join((*OTHERS, WARNINGS))}",
            )


def _requirement(name: str, table: Any) -> AnyRequirement:
    keys = ("most",) if name == WARNINGS else KEYS
    if not isinstance(table, dict) or not table:
        raise ValueError(f"[{name}] must be a table with {', '.join(keys)}")
    for key in table:
        if key not in keys:
            raise ValueError(f"[{name}] {unknown('key', key, keys)}")
    if name == WARNINGS:
        if table["most"] not in SEVERITIES_ALLOWED:
            raise ValueError(
                f"[{name}] {unknown('severity', str(table['most']), SEVERITIES_ALLOWED)}"
            )
        return WarningRequirement(table["most"])
    bounds = {key: table[key] for key in ("least", "most") if key in table}
    unit = ""
    if name.startswith("std.") and any(isinstance(bound, str) for bound in bounds.values()):
        unit = " %"
        bounds = {key: _per_cent(name, key, bound) for key, bound in bounds.items()}
    least, most = (
        None if key not in bounds else _number(name, key, bounds[key]) for key in ("least", "most")
    )
    if ("nominal" in table) != ("within" in table):
        raise ValueError(f"[{name}] needs both nominal and within")
    if "nominal" in table:
        if least is not None or most is not None:
            raise ValueError(
                f"[{name}] may have nominal and within, or least and most, but not both"
            )
        nominal = _number(name, "nominal", table["nominal"])
        within = _within(name, table["within"], nominal)
        least, most = nominal - within, nominal + within
    if least is not None and most is not None and least > most:
        raise ValueError(f"[{name}] least is above most")
    return Requirement(name, least, most, unit)


def _number(name: str, key: str, value: Any) -> float:
    try:
        return real_number(value, f"[{name}] {key}")
    except TypeError as error:
        raise ValueError(str(error)) from error


def _within(name: str, value: Any, nominal: float) -> float:
    if isinstance(value, str):
        return abs(nominal) * _per_cent(name, "within", value) / 100.0
    within = _number(name, "within", value)
    if within < 0:
        raise ValueError(f"[{name}] within must not be negative, but is {within}")
    return within


def _per_cent(name: str, key: str, value: Any) -> float:
    match = PER_CENT.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        expected = "a number or" if key == "within" else "in per cent like the other bound,"
        raise ValueError(f'[{name}] {key} must be {expected} as "1 %", not {value!r}')
    return float(match[1])
