"""Manifests: files with a camera in each record, which are read one by one."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from trisquare._support.json_members import parse_json
from trisquare._support.paths import naming_failure, open_at_once
from trisquare._support.suggestions import unknown
from trisquare.batch.jobs import FILE_OPTIONS, OPTIONS, Job, faulty_job

MANIFESTS = (".csv", ".jsonl", ".ndjson")

SEVERAL = ("fix", "free", "orthogonal", "parallel")
"""Options with several values; in CSV they are separated by semicolons, a pair is ``0-1``."""

LONGEST_LINE = 1 << 20
"""Maximum number of characters of a line."""

MAX_FAULTS = 10_000
"""Maximum number of wrong records that are read of a manifest: each becomes a record of the batch,
and a small file may have hundreds of thousands."""


def manifest_jobs(path: str, options: Mapping[str, Any]) -> Iterator[Job]:
    """Read the jobs of a manifest one by one; a wrong record is a job with a fault.

    After `MAX_FAULTS` wrong records the rest is one more such job.

    Parameters
    ----------
    path : str
        ``.jsonl``: one object per line, with ``name``, ``photographs`` (one, or a list) and options
        of `calibrate`. ``.csv``: these are the columns, photographs are separated by semicolons,
        and empty cells are ignored. Files are relative to the manifest's folder.
    options : mapping
        Defaults for records that do not have them.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If a CSV file has wrong columns.
    """
    records = _csv_records if Path(path).suffix.lower() == ".csv" else _json_records
    folder = os.path.dirname(path)
    count = faults = 0
    try:
        for number, record in records(path):
            count += 1
            origin = f"{path}:{number}"
            try:
                yield _job(record, folder, options, origin)
            except (TypeError, ValueError) as error:
                if faults == MAX_FAULTS:
                    text = f"{faults} earlier records are wrong: the rest of the file is not read"
                    yield faulty_job(path, text, origin)
                    return
                faults += 1
                yield faulty_job(origin, str(error), origin)
    except UnicodeDecodeError as error:
        yield faulty_job(path, f"after {count} records: not UTF-8: {error}", path)
        return
    if not count:
        yield faulty_job(path, "the manifest contains no record", path)


def _job(record: Any, folder: str, options: Mapping[str, Any], origin: str) -> Job:
    if isinstance(record, ValueError):
        raise record
    if not isinstance(record, dict):
        raise ValueError("a record must be an object with a name and photographs")
    options_of_record = dict(record)
    for member in ("name", "photographs"):
        if member not in options_of_record:
            raise ValueError(f'"{member}" is missing')
    name, stated = options_of_record.pop("name"), options_of_record.pop("photographs")
    photographs = [stated] if isinstance(stated, str) else stated
    if not isinstance(photographs, list) or not all(
        isinstance(photograph, str) for photograph in photographs
    ):
        raise ValueError('"photographs" must be a file or a list of files')
    for option in FILE_OPTIONS:
        if isinstance(options_of_record.get(option), str):
            resolved = os.path.join(folder, options_of_record[option])
            # A target may also be a name, not a layout's file.
            if option != "targets" or options_of_record[option].lower().endswith(".json"):
                options_of_record[option] = resolved
    return Job(
        name,
        tuple(os.path.join(folder, photograph) for photograph in photographs),
        {
            **options,
            **{key: value for key, value in options_of_record.items() if value is not None},
        },
        origin,
    )


def _opened(path: str, newline: str | None = None) -> TextIO:
    with naming_failure(path):
        return open(path, encoding="utf-8-sig", newline=newline, opener=open_at_once)


def _json_records(path: str) -> Iterator[tuple[int, Any]]:
    with _opened(path) as file:
        number = 0
        while line := file.readline(LONGEST_LINE):
            number += 1
            if len(line) >= LONGEST_LINE and not line.endswith("\n"):
                yield number, ValueError(f"the line has more than {LONGEST_LINE} characters")
                return
            if line.strip():
                try:
                    yield number, parse_json(line.rstrip())
                except ValueError as error:
                    yield number, error


def _csv_records(path: str) -> Iterator[tuple[int, Any]]:
    import csv  # needed only here

    with _opened(path, newline="") as file:
        rows = csv.reader(file, strict=True)
        try:
            columns = [name.strip() for name in next(rows, [])]
            _check_columns(path, columns)
        except csv.Error as error:
            raise ValueError(f"{path}: line 1: {error}") from error
        while True:
            first = rows.line_num + 1
            try:
                row = next(rows)
            except StopIteration:
                return
            except csv.Error as error:
                yield first, ValueError(str(error))
                continue
            if row:
                yield first, _of_row(columns, row)


def _check_columns(path: str, columns: Sequence[str]) -> None:
    for name in ("name", "photographs"):
        if name not in columns:
            hint = "; commas separate columns" if any(";" in column for column in columns) else ""
            raise ValueError(f"{path}: the first line has no column {name!r}{hint}")
    for name in columns:
        if name not in ("name", "photographs", *OPTIONS):
            raise ValueError(f"{path}: {unknown('column', name, OPTIONS)}")
    if len(set(columns)) < len(columns):
        raise ValueError(f"{path}: two columns have one name")


def _of_row(columns: Sequence[str], row: Sequence[str]) -> Any:
    if len(row) != len(columns):
        return ValueError(f"{len(row)} cells, but {len(columns)} columns")
    record: dict[str, Any] = {}
    for column, cell in zip(columns, row, strict=True):
        if not cell.strip():
            continue
        try:
            record[column] = _cell(column, cell)
        except ValueError as error:
            return error
    return record


def _cell(column: str, cell: str) -> Any:
    if column == "photographs":
        return [one.strip() for one in cell.split(";") if one.strip()]
    if column in ("orthogonal", "parallel"):
        pairs = [one.split("-") for one in cell.split(";")]
        if not all(
            len(pair) == 2 and all(one.strip().isdecimal() for one in pair) for pair in pairs
        ):
            raise ValueError(f"{column}: two planes are written 0-1, not {cell!r}")
        return [[int(one) for one in pair] for pair in pairs]
    if column in SEVERAL:
        return [one.strip() for one in cell.split(";")]
    if column == "frames":
        if not cell.strip().isdecimal():
            raise ValueError(f"frames must be a whole number, not {cell!r}")
        return int(cell)
    if column == "lines":
        if cell.strip().lower() not in ("true", "false"):
            raise ValueError(f"lines must be true or false, not {cell!r}")
        return cell.strip().lower() == "true"
    if column == "tone":
        try:
            return float(cell)
        except ValueError:
            return cell.strip()
    return cell if column == "name" else cell.strip()
