"""Warnings about problems to resolve before relying on a result."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import FrozenInstanceError
from typing import Any, Literal, NoReturn

from trisquare._support.arrays import index_number, string
from trisquare._support.json_members import JsonFields
from trisquare._support.records import Kind
from trisquare._support.suggestions import unknown
from trisquare.errors import help_of

Severity = Literal["high", "medium", "low"]

SEVERITIES: tuple[Severity, ...] = ("high", "medium", "low")
"""Severities in the order in which warnings are listed."""


class CalibrationWarning(str):
    """A warning: its text, with a code that is stable across versions.

    Parameters
    ----------
    text : str
        The problem, its effect on the result, and the remedy.
    code : str
        Name of the problem, the same in all versions; `help` names the page that explains it.
    severity : {"high", "medium", "low"}
        ``"high"``: the result may be wrong beyond its uncertainty; ``"medium"``: something should
        be checked; ``"low"``: something was left out or an interval widened.
    plane : int, optional
        Index of the plane that it is about.

    Examples
    --------
    >>> warning = ts.CalibrationWarning("a side is bent", "side_rejected", "medium", plane=1)
    >>> warning, warning.code, warning.plane
    ('a side is bent', 'side_rejected', 1)
    """

    code: str
    severity: Severity
    plane: int | None

    def __new__(
        cls, text: str, code: str = "other", severity: str = "medium", plane: int | None = None
    ) -> CalibrationWarning:
        """Check the parts.

        Raises
        ------
        TypeError, ValueError
            If a part has the wrong type, or the severity is unknown.
        """
        if severity not in SEVERITIES:
            raise unknown("severity", str(severity), SEVERITIES)
        self = super().__new__(cls, string(text, "text"))
        vars(self)["code"] = string(code, "code")
        vars(self)["severity"] = SEVERITIES[SEVERITIES.index(severity)]
        vars(self)["plane"] = None if plane is None else index_number(plane, "plane")
        return self

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __getnewargs__(self) -> tuple[str, str, str, int | None]:  # type: ignore[override]
        return self.text, self.code, self.severity, self.plane

    @property
    def text(self) -> str:
        """The warning without its code."""
        return str(self)

    @property
    def help(self) -> str:
        """Page of the documentation that explains it, relative to the folder of the pages."""
        return help_of(self.code)


def by_severity(warnings: Iterable[CalibrationWarning]) -> list[CalibrationWarning]:
    """Return warnings with the most severe first."""
    return sorted(warnings, key=lambda warning: SEVERITIES.index(warning.severity))


def _checked(values: Any, name: str) -> tuple[CalibrationWarning, ...]:
    if isinstance(values, str):
        raise TypeError(f"{name} must be a sequence of warnings, not one str")
    return tuple(
        value if isinstance(value, CalibrationWarning) else CalibrationWarning(string(value, name))
        for value in values
    )


def _read(members: JsonFields, key: str) -> tuple[CalibrationWarning, ...]:
    """Read warnings; results of versions before the codes have only texts."""
    values = members.value(key)
    if isinstance(values, list) and all(isinstance(value, str) for value in values):
        return tuple(CalibrationWarning(text) for text in members.texts(key))
    return tuple(
        CalibrationWarning(
            warning.text("text"),
            warning.text("code"),
            warning.text("severity"),
            warning.integer("plane") if warning.has("plane") else None,
        )
        for warning in members.objects(key)
    )


def warning_members(warnings: Iterable[CalibrationWarning]) -> list[dict[str, Any]]:
    """Return warnings as JSON objects."""
    return [
        {
            "code": warning.code,
            "severity": warning.severity,
            **({} if warning.plane is None else {"plane": warning.plane}),
            "text": warning.text,
        }
        for warning in warnings
    ]


WARNINGS = Kind(_checked, _read, warning_members)
