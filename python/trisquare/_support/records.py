"""Frozen records whose members are declared once, for checks and for JSON.

>>> @dataclass(frozen=True, slots=True)
... class Place(Record):
...     image: int = field(metadata=member(INDEX))
...     residual: float | None = field(default=None, metadata=member(NUMBER, "residual_px"))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any, TypeVar

import numpy as np

from trisquare._support.arrays import (
    ComparedByValue,
    RebuiltByConstructor,
    index_number,
    instances,
    not_negative,
    pixel_array,
    real_array,
    real_number,
    sequence,
    string,
    strings,
)
from trisquare._support.json_members import JsonFields

R = TypeVar("R", bound="Record")
F = TypeVar("F", bound=RebuiltByConstructor)


@dataclass(frozen=True, slots=True)
class Kind:
    """Check, reader and writer for members of one kind.

    Parameters
    ----------
    check : callable
        Returns the stored value for a value and its name; raises TypeError or ValueError.
    read : callable
        Returns the value for the members of a JSON object and a key.
    write : callable, optional
        Returns the JSON value for the stored one, if its class does not determine it.
    """

    check: Callable[[Any, str], Any]
    read: Callable[[JsonFields, str], Any]
    write: Callable[[Any], Any] | None = None


TEXT = Kind(string, JsonFields.text)
TEXTS = Kind(strings, JsonFields.texts)
INDEX = Kind(index_number, JsonFields.integer)
REAL = Kind(real_number, JsonFields.number)
NUMBER = Kind(not_negative, JsonFields.number)
"""Kind of numbers that are not negative."""


def array(*shape: int | None) -> Kind:
    """Return the kind of arrays of a shape; None means any length."""
    return Kind(
        lambda value, name: real_array(value, name, shape),
        lambda members, key: members.array(key, shape),
    )


def pixels(*shape: int | None) -> Kind:
    """Return the kind of arrays of pixel coordinates of a shape."""
    return Kind(
        lambda value, name: pixel_array(value, name, shape),
        lambda members, key: members.array(key, shape),
    )


def arrays(*shape: int | None) -> Kind:
    """Return the kind of sequences of arrays of a shape."""
    return Kind(
        lambda values, name: tuple(
            real_array(value, name, shape) for value in sequence(values, name, "arrays")
        ),
        lambda members, key: members.arrays(key, shape),
    )


def record(kind: type[Record]) -> Kind:
    """Return the kind of another record."""

    def check(value: Any, name: str) -> Any:
        if not isinstance(value, kind):
            raise TypeError(f"{name} must be of the class {kind.__name__}")
        return value

    return Kind(check, lambda members, key: record_from_members(kind, members.object(key)))


def records(kind: type[Record]) -> Kind:
    """Return the kind of sequences of other records."""
    return Kind(
        lambda values, name: instances(values, kind, name),
        lambda members, key: tuple(
            record_from_members(kind, record_members_json)
            for record_members_json in members.objects(key)
        ),
    )


def member(kind: Kind, key: str | None = None) -> Mapping[str, Any]:
    """Return the metadata of a field: its kind, and its key in JSON, by default its name."""
    return {"kind": kind, "key": key}


class Record(RebuiltByConstructor, ComparedByValue):
    """A frozen dataclass whose fields declare their kinds by `member`.

    A field with the default None or ``()`` may have that value, and is then left out of JSON.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        check_members(self)

    def members(self) -> dict[str, Any]:
        """Return the record as a JSON object, in the form of all JSON of trisquare."""
        return record_members(self)


def check_members(record: Record) -> None:
    """Check all fields of a record that have a kind."""
    for field, kind, _ in _members_of(type(record)):
        value = getattr(record, field.name)
        if value is not None or field.default is not None:
            object.__setattr__(record, field.name, kind.check(value, field.name))


def of_core(kind: type[F], /, **members: Any) -> F:
    """Create a record from results of the core, without checking or copying.

    The arrays are made read-only.
    """
    record, keep = object.__new__(kind), object.__setattr__
    for name, value in (_defaults_of(kind) | members).items():
        if type(value) is np.ndarray:
            value.setflags(write=False)
        elif type(value) is tuple:
            for element in value:
                if type(element) is np.ndarray:
                    element.setflags(write=False)
        keep(record, name, value)
    return record


def record_members(record: Record) -> dict[str, Any]:
    """Return the fields of a record that have a kind as members of a JSON object."""
    members = {}
    for field, kind, key in _members_of(type(record)):
        value = getattr(record, field.name)
        is_absent = value is None or (isinstance(value, tuple) and not value)
        if not (_is_optional(field) and is_absent):
            members[key] = (kind.write or _plain)(value)
    return members


def record_from_members(kind: type[R], members: JsonFields, **others: Any) -> R:
    """Read a record from a JSON object; `others` are its fields without a kind."""
    values = {
        field.name: field_kind.read(members, key)
        for field, field_kind, key in _members_of(kind)
        if members.has(key) or not _is_optional(field)
    }
    return kind(**values, **others)


def _is_optional(field: Field[Any]) -> bool:
    return field.default in (None, ())


_MEMBERS: dict[Any, list[tuple[Field[Any], Kind, str]]] = {}
"""Members by class, cached."""


def _members_of(kind: Any) -> list[tuple[Field[Any], Kind, str]]:
    if kind not in _MEMBERS:
        declared = [field for field in fields(kind) if field.metadata]
        _MEMBERS[kind] = [
            (field, field.metadata["kind"], field.metadata["key"] or field.name)
            for field in declared
        ]
    return _MEMBERS[kind]


_DEFAULTS: dict[Any, dict[str, Any]] = {}
"""Defaults by class, cached."""


def _defaults_of(kind: Any) -> dict[str, Any]:
    if kind not in _DEFAULTS:
        _DEFAULTS[kind] = {
            field.name: field.default for field in fields(kind) if field.default is not MISSING
        }
    return _DEFAULTS[kind]


def _plain(value: Any) -> Any:
    """Return a value in the form for JSON."""
    if isinstance(value, Record):
        return record_members(value)
    if isinstance(value, tuple):
        return [_plain(element) for element in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return dict(value) if isinstance(value, Mapping) else value
