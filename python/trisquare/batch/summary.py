"""Summary of a batch: a page, a table for programs, and counts."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from trisquare._support.writing import PathLike, replacing
from trisquare.batch.fleet import Fleet, verdict
from trisquare.batch.requirements import OTHERS, PARAMETERS, AnyRequirement
from trisquare.results.calibration_warning import SEVERITIES

TABLE_FORMAT = "trisquare-batch-table/1"

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
"""First characters of texts that spreadsheets take for a formula (OWASP, "CSV Injection")."""

CHUNK = 5_000
"""Number of rows of a Parquet file that are in memory at a time."""

TEXTS = (
    "name",
    "status",
    "error",
    "model",
    "beyond_limits",
    "outlying",
    "retake",
    "failure",
    "severity",
    "warnings",
    "limits",
    "format",
)
WHOLE = ("width", "height", "planes")


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of cameras of a batch, by status.

    Cameras of earlier runs that this run was not given count only as `earlier`. Cameras that passed
    with a warning of high severity are included in `passed`.
    """

    passed: int
    passed_with_high_warning: int
    beyond_limits: int
    failed: int
    earlier: int
    retake: int
    outlying: int

    @property
    def total(self) -> int:
        """Number of cameras of this run."""
        return self.passed + self.beyond_limits + self.failed

    @property
    def all_passed(self) -> bool:
        """Whether there is a camera, and none that failed or is beyond the limits."""
        return self.passed == self.total > 0


def rows(
    records: Iterable[Mapping[str, Any]], fleet: Fleet, requirements: Sequence[AnyRequirement]
) -> Iterator[dict[str, Any]]:
    """Yield a row for each camera, with those of `columns` that apply.

    Rows of failed cameras also have ``removed``: the file of an earlier result, if there was one.
    """
    limits = "; ".join(map(str, requirements))
    for record in records:
        found = verdict(record, fleet, requirements)
        row: dict[str, Any] = {
            "name": record["name"],
            "status": found.status,
            "photographs": record["photographs"],
            "retake": "; ".join(found.retake),
            "failure": found.failure,
            "limits": limits,
            "format": TABLE_FORMAT,
        }
        if record["status"] == "done":
            row["width"], row["height"] = record["image_size"]
            row["model"] = record["model"]
            row["beyond_limits"] = "; ".join(found.violations)
            row["outlying"] = "; ".join(found.outlying)
            row["severity"] = _highest_severity(record)
            row["warnings"] = "; ".join(warning["code"] for warning in record["warnings"])
            row |= {name: record[name] for name in OTHERS} | record["values"]
            row |= {f"std_{name}": std for name, std in record["std"].items()}
        else:
            row["error"] = record["error"]["code"]
            row["removed"] = record.get("removed", "")
        yield row


def columns(fleet: Fleet) -> list[str]:
    """Return the columns of a table, with the parameters that some camera estimates."""
    estimated = {name for _, name in fleet.distributions}
    numbers = [
        column for name in PARAMETERS if name in estimated for column in (name, f"std_{name}")
    ]
    head = ("name", "status", "error", "model", "width", "height")
    return [
        *head,
        *numbers,
        *OTHERS,
        "beyond_limits",
        "outlying",
        "retake",
        "failure",
        "severity",
        "warnings",
        "photographs",
        "limits",
        "format",
    ]


def write_csv(path: PathLike, rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> Counts:
    """Write a table as CSV, completely or not at all, and count its cameras.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    counts: Counter[str] = Counter()
    with replacing(path) as file:
        text = io.TextIOWrapper(file, "utf-8", "backslashreplace", newline="", write_through=True)
        table = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        for row in rows:
            of_high = (row["status"], row.get("severity")) == ("passed", SEVERITIES[0])
            counts.update([row["status"]] + ["passed with high"] * of_high)
            counts.update(reason for reason in ("retake", "outlying") if row.get(reason))
            joined = {**row, "photographs": ";".join(row["photographs"])}
            table.writerow({name: _inert(value) for name, value in joined.items()})
        text.detach()
    return Counts(
        passed=counts["passed"],
        passed_with_high_warning=counts["passed with high"],
        beyond_limits=counts["beyond limits"],
        failed=counts["failed"],
        earlier=counts["earlier"],
        retake=counts["retake"],
        outlying=counts["outlying"],
    )


def write_parquet(
    path: PathLike, rows: Iterable[Mapping[str, Any]], columns: Sequence[str]
) -> None:
    """Write a table as Parquet, completely or not at all.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    OSError
        If it cannot be written.
    """
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    def kind(column: str) -> Any:
        if column == "photographs":
            return pyarrow.list_(pyarrow.string())
        if column in TEXTS:
            return pyarrow.string()
        return pyarrow.int64() if column in WHOLE else pyarrow.float64()

    schema = pyarrow.schema([(column, kind(column)) for column in columns])
    of_columns = ({name: _text(row.get(name)) for name in columns} for row in rows)
    with replacing(path) as file, pyarrow.parquet.ParquetWriter(file, schema) as writer:
        while chunk := list(islice(of_columns, CHUNK)):
            writer.write_table(pyarrow.Table.from_pylist(chunk, schema))


def check_parquet() -> None:
    """Raise ImportError, with what to install, unless Parquet can be written."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise ImportError("Parquet needs pyarrow: pip install 'trisquare[batch]'") from error


def _inert(value: Any) -> Any:
    """Return a cell that spreadsheets do not take for a formula; numbers are unchanged."""
    is_formula = isinstance(value, str) and value.startswith(FORMULA_STARTS)
    return f"'{value}" if is_formula else value


def _text(value: Any) -> Any:
    """Return a value as valid UTF-8: a file's name may contain bytes that are not text."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    return [_text(element) for element in value] if isinstance(value, list) else value


def _highest_severity(record: Mapping[str, Any]) -> str:
    """Return the highest severity of a camera's warnings, empty without warnings."""
    found = {warning["severity"] for warning in record["warnings"]}
    return next((severity for severity in SEVERITIES if severity in found), "")
