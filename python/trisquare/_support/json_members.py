"""Reading of JSON objects, with errors that name the key."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from trisquare._support.arrays import FloatArray, real_array

KINDS = {
    "trisquare/1": "a calibration",
    "trisquare-camera/1": "a camera without its uncertainties",
    "trisquare-edges/1": "measured edges",
    "trisquare-outlines/1": "outlines drawn by hand",
    "trisquare-plan/1": "a plan of a photograph",
}
"""Descriptions of the formats of users' files."""


def _kind_of(stated: str) -> str:
    """Return the description of a format in brackets, empty if it is unknown."""
    return f" ({KINDS[stated]})" if stated in KINDS else ""


class JsonFields:
    """Members of one JSON object, read by key and by type.

    Every reader raises ValueError naming the full key, such as ``planes[1].corners``. Other keys
    are ignored, so that older programs can read newer files.
    """

    def __init__(self, members: Any, where: str = "") -> None:
        if not isinstance(members, dict):
            raise ValueError(f"{where or 'the JSON text'} must be an object")
        self._members: dict[str, Any] = members
        self._where = where

    @classmethod
    def parse(cls, text: str | bytes, expected_format: str | None = None) -> JsonFields:
        """Parse a complete text and check its ``format`` member, if one is expected."""
        if not isinstance(text, str | bytes):
            raise TypeError(f"JSON text must be a str, not {type(text).__name__}")
        fields = cls(parse_json(text))
        if expected_format is not None:
            fields.check_format(expected_format)
        return fields

    def check_format(self, expected: str) -> None:
        """Raise ValueError if the ``format`` member is another."""
        if (stated := self.text("format")) != expected:
            raise ValueError(
                f'"format" is {reprlib.repr(stated)}{_kind_of(stated)}, '
                f"but {expected!r} is read here{_kind_of(expected)}"
            )

    def _key(self, key: str) -> str:
        return f"{self._where}.{key}" if self._where else key

    def _fail(self, key: str, expected: str) -> NoReturn:
        raise ValueError(f'"{self._key(key)}" must be {expected}')

    def value(self, key: str) -> Any:
        """Return the member as it was parsed; it must be present."""
        if key not in self._members:
            inner = self._members.get("result")  # as in answers of `trisquare serve`
            hint = ': pass its member "result"' if isinstance(inner, dict) and key in inner else ""
            raise ValueError(f'"{self._key(key)}" is missing{hint}')
        return self._members[key]

    def names(self) -> tuple[str, ...]:
        """Return the keys that are strings; YAML also allows others."""
        return tuple(key for key in self._members if isinstance(key, str))

    def has(self, key: str) -> bool:
        """Return whether an optional member is present and not null."""
        return self._members.get(key) is not None

    def text(self, key: str) -> str:
        """Return a string."""
        value = self.value(key)
        if not isinstance(value, str):
            self._fail(key, "a string")
        return value

    def integer(self, key: str) -> int:
        """Return a whole number."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int):
            self._fail(key, "a whole number")
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        return float(self.array(key, ()))

    def number_or(self, key: str, default: float) -> float:
        """Return a finite number, or `default` if the member is missing or null."""
        return self.number(key) if self.has(key) else default

    def truth(self, key: str) -> bool:
        """Return true or false."""
        value = self.value(key)
        return value if isinstance(value, bool) else self._fail(key, "true or false")

    def array(self, key: str, shape: tuple[int | None, ...]) -> FloatArray:
        """Return a finite, read-only array of numbers of the given shape."""
        return self._array(self.value(key), key, shape)

    def arrays(self, key: str, shape: tuple[int | None, ...]) -> tuple[FloatArray, ...]:
        """Return a list of finite, read-only arrays of numbers."""
        return tuple(
            self._array(value, f"{key}[{index}]", shape)
            for index, value in enumerate(self._list(key))
        )

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings."""
        values = self._list(key)
        if not all(isinstance(value, str) for value in values):
            self._fail(key, "a list of strings")
        return tuple(values)

    def integers(self, key: str) -> tuple[int, ...]:
        """Return a list of whole numbers."""
        values = self._list(key)
        if not all(isinstance(value, int) and not isinstance(value, bool) for value in values):
            self._fail(key, "a list of whole numbers")
        return tuple(values)

    def pairs(self, key: str) -> tuple[tuple[int, int], ...]:
        """Return a list of pairs of whole numbers."""
        requirement = "a list of pairs of whole numbers"
        pairs = []
        for pair in self._list(key):
            is_pair = isinstance(pair, list) and len(pair) == 2
            if not (is_pair and all(type(number) is int for number in pair)):
                self._fail(key, requirement)
            pairs.append((pair[0], pair[1]))
        return tuple(pairs)

    def numbers_or_null(self, key: str) -> tuple[float | None, ...]:
        """Return a list of finite numbers, each of which may be null."""
        return tuple(
            None if value is None else float(self._array(value, f"{key}[{index}]", ()))
            for index, value in enumerate(self._list(key))
        )

    def numbers_by_name(self, key: str) -> dict[str, float]:
        """Return an object whose members are all finite numbers."""
        members = self.object(key)
        return {name: members.number(name) for name in members._members}

    def object(self, key: str) -> JsonFields:
        """Return a nested object."""
        return JsonFields(self.value(key), self._key(key))

    def objects(self, key: str) -> tuple[JsonFields, ...]:
        """Return a list of nested objects."""
        return tuple(
            JsonFields(value, f"{self._key(key)}[{index}]")
            for index, value in enumerate(self._list(key))
        )

    def _list(self, key: str) -> list[Any]:
        value = self.value(key)
        if not isinstance(value, list):
            self._fail(key, "a list")
        return value

    def _array(self, value: Any, key: str, shape: tuple[int | None, ...]) -> FloatArray:
        try:
            # The second dimension of an empty list of rows is unknown.
            if value == [] and len(shape) == 2 and shape[0] in (None, 0):
                value = np.empty((0, shape[1] or 0))
            return real_array(value, f'"{self._key(key)}"', shape)
        except TypeError as error:
            raise ValueError(str(error)) from error


def parse_json(text: str | bytes) -> Any:
    """Parse JSON; every error is a ValueError."""
    try:
        return json.loads(text, parse_constant=refuse_constant)
    except RecursionError as error:
        raise ValueError("the JSON text is nested too deeply") from error
    except json.JSONDecodeError as error:
        line = f"line {error.lineno}, " if "\n" in error.doc else ""
        raise ValueError(f"not JSON: {error.msg} ({line}column {error.colno})") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"not JSON: {error}") from error


def refuse_constant(constant: str) -> NoReturn:
    """Refuse NaN and the infinities; for ``parse_constant`` of `json.loads`."""
    raise ValueError(f"the JSON text contains {constant}, which is not JSON")


def dump_members(members: Mapping[str, Any]) -> str:
    """Write an object with one member per line, and lists of objects with one object per line.

    Arrays are written on one line, so that people can read and compare the file. Floats are
    written so that they read back exactly; NaN is refused.
    """
    lines = [f"  {json.dumps(key)}: {_dump_value(value)}" for key, value in members.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _dump_value(value: Any) -> str:
    if isinstance(value, Sequence) and value and isinstance(value[0], Mapping):
        rows = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in value)
        return f"[\n{rows}\n  ]"
    return json.dumps(value, allow_nan=False)
