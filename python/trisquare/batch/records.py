"""Validation of the lines of ``results.jsonl``: a run may have been killed, or a disk damaged."""

from __future__ import annotations

from typing import Any

from trisquare._support.json_members import JsonFields, parse_json
from trisquare._support.suggestions import unknown
from trisquare.batch.jobs import Job
from trisquare.batch.requirements import OTHERS, PARAMETERS
from trisquare.batch.worker import RECORD_FORMAT
from trisquare.results.calibration_warning import SEVERITIES

LARGEST = 1e100
"""Largest number of a camera: larger ones, from a damaged line, could overflow in the summary."""


def record_in(line: bytes) -> dict[str, Any]:
    """Return the record in a line.

    Raises
    ------
    ValueError
        If it is not a record, or lacks what the summary needs, or has it with another type.
    """
    record = parse_json(line)
    fields = JsonFields(record)
    if fields.has("format"):  # missing in older lines
        fields.check_format(RECORD_FORMAT)
    for name in ("name", "key", "status"):
        fields.text(name)
    fields.texts("photographs")
    if record["status"] == "done":
        _check_camera(fields)
    else:
        error = fields.object("error")
        error.text("code")
        error.text("text")
        fields.numbers_by_name("limits")
        if fields.has("removed"):
            fields.text("removed")
    checked: dict[str, Any] = record
    return checked


def _check_camera(fields: JsonFields) -> None:
    fields.text("model")
    fields.integer("planes")
    if len(fields.integers("image_size")) != 2:
        raise ValueError('"image_size" must be [width, height]')
    for key, least in (("values", -LARGEST), ("std", 0.0)):
        numbers = fields.object(key)
        for name in numbers.names():
            if name not in PARAMETERS:
                raise ValueError(f"{name!r} is not a parameter")
            _check_number(numbers.value(name), least)
    for name in OTHERS:
        _check_number(fields.value(name), 0.0)
    for warning in fields.objects("warnings"):
        warning.text("code")
        warning.text("text")
        if (severity := warning.text("severity")) not in SEVERITIES:
            raise unknown("severity", severity, SEVERITIES)


def _check_number(value: Any, least: float) -> None:
    """Raise ValueError if a value is not possible for a camera."""
    if type(value) not in (int, float) or not least <= value <= LARGEST:
        raise ValueError(f"no camera has {value!r}")


def identity_in(line: bytes) -> str | None:
    """Return the identity of the job of a record; None if the line is not a record."""
    try:
        return _identity(record_in(line)["name"])
    except ValueError:
        return None


def stated_identity(line: bytes) -> str | None:
    """Return the identity that a line states, whatever else it has; None if it states none.

    The line may be written by another version.
    """
    try:
        return _identity(JsonFields(parse_json(line)).text("name"))
    except ValueError:
        return None


def _identity(name: str) -> str:
    return Job(name, ("",)).identity
