"""Lengths with their units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from trisquare._support.arrays import real_number
from trisquare._support.suggestions import unknown

METRES = {
    "um": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "km": 1e3,
    "in": 0.0254,
    "ft": 0.3048,
}
"""Length of each unit in metres."""

MICROMETRES = str.maketrans({"µ": "u", "μ": "u"})
"""Replacement of the micro sign and of the Greek letter by ``u``."""

LENGTH = re.compile(r"([0-9.eE+-]+)\s*([A-Za-z]*)")


@dataclass(frozen=True, slots=True)
class Length:
    """A length with its unit, which may be empty."""

    value: float
    unit: str

    @classmethod
    def parse(cls, text: str) -> Length:
        """Parse a text such as ``"50mm"``.

        Raises
        ------
        ValueError
            If it is not a positive number with a known unit or none.
        """
        found = LENGTH.fullmatch(text.strip().translate(MICROMETRES))
        try:
            value = float(found[1]) if found else math.nan
        except ValueError:
            value = math.nan
        if value <= 0:
            raise ValueError(f"a length must be positive, not {text!r}")
        if found is None or not value < math.inf:
            units = ", ".join(METRES)
            raise ValueError(f"a length is written 50mm (units: {units}), not {text!r}")
        if found[2] not in ("", *METRES):
            raise unknown("unit", found[2], METRES)
        return cls(value, found[2])

    @classmethod
    def with_unit(cls, text: str, name: str) -> Length:
        """Parse a text such as ``"50mm"``, and refuse a number without a unit.

        Raises
        ------
        ValueError
            If it is not a positive number with a known unit.
        """
        stated = cls.parse(text)
        if not stated.unit:
            raise ValueError(
                f"{name} needs a unit (one of {', '.join(METRES)}), such as {stated.value:g}mm"
            )
        return stated

    @classmethod
    def of_metres(cls, value: float) -> Length:
        """Return a length in metres, or in millimetres if it is shorter than a metre."""
        return cls(value, "m") if value >= 1 else cls(1000.0 * value, "mm")

    @property
    def metres(self) -> float:
        """The length in metres; without a unit it is in metres."""
        return self.of_unit("m")

    def of_unit(self, unit: str) -> float:
        """Return the length in `unit`; without a unit it is in that unit already."""
        if self.unit in ("", unit):
            return self.value
        return self.value * METRES[self.unit] / METRES[unit]

    def after(self, number: str, power: str = "") -> str:
        """Return the text of a number with this unit."""
        return f"{number} {self.unit}{power}" if self.unit else number


def length_in(unit: str, length: str | float | None, name: str) -> float | None:
    """Return a length in a unit, from a text such as ``"84mm"`` or a number in that unit.

    Raises
    ------
    TypeError, ValueError
        If it is not a positive length, or is a text without a unit.
    """
    if length is None:
        return None
    if not isinstance(length, str):
        value = real_number(length, name)
        if value <= 0:
            raise ValueError(f"{name} must be positive, not {value:g}")
        return value
    return Length.with_unit(length, name).of_unit(unit)
