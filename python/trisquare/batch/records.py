"""The lines of ``results.jsonl``, checked: a run may have been killed, or a disk may be damaged."""

from __future__ import annotations

from typing import Any

from trisquare._support.json_members import JsonFields, parse_json
from trisquare._support.suggestions import unknown
from trisquare.batch.jobs import Job
from trisquare.batch.requirements import OTHERS, PARAMETERS
from trisquare.batch.worker import RECORD_FORMAT
from trisquare.results.calibration_warning import SEVERITIES

LARGEST = 1e100
"""Of a camera's numbers: those of a damaged line are not to overflow in the summary."""


def record_in(line: bytes) -> dict[str, Any]:
    """Return the record that a line is.

    Raises
    ------
    ValueError
        If it is none, or what the summary needs of it is missing or of another type.
    """
    record = parse_json(line)
    fields = JsonFields(record)
    if fields.has("format"):  # which older lines lack
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
                raise ValueError(f"{name!r} is no parameter")
            _check_number(numbers.value(name), least)
    for name in OTHERS:
        _check_number(fields.value(name), 0.0)
    for warning in fields.objects("warnings"):
        warning.text("code")
        warning.text("text")
        if (severity := warning.text("severity")) not in SEVERITIES:
            raise unknown("severity", severity, SEVERITIES)


def _check_number(value: Any, least: float) -> None:
    """Raise ValueError if a value is none that a camera has."""
    if type(value) not in (int, float) or not least <= value <= LARGEST:
        raise ValueError(f"no camera has {value!r}")


def identity_in(line: bytes) -> str | None:
    """Return whose record a line is; None if it is none."""
    try:
        return _identity(record_in(line)["name"])
    except ValueError:
        return None


def stated_identity(line: bytes) -> str | None:
    """Return whose record a line states to be, whatever else it holds; None if it states nobody's.

    Another version may have written it.
    """
    try:
        return _identity(JsonFields(parse_json(line)).text("name"))
    except ValueError:
        return None


def _identity(name: str) -> str:
    return Job(name, ("",)).identity
