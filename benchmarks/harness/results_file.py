"""The last rows of every benchmark in machine-readable form, and their changes."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.rows import Row

FILE = Path(__file__).parents[1] / "results.json"

CHANGED = 0.05
"""Minimum relative change that is reported: times on a shared machine scatter by this amount."""

NUMBER = r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?"
FIGURE = re.compile(rf"(?:.* = )?({NUMBER})(?:/({NUMBER}))? ?(%|px|ms|ns|MB|levels?)?(?![\w])")

Record = dict[str, Any]


def record(benchmark: str, row: Row, commit: str) -> Record:
    """Return the first number of a row's result, or the one after an equals sign, with its unit.

    The value of a result that begins with a word is its text.
    """
    found = FIGURE.match(row.result)
    value: float | str = row.result
    unit = ""
    if found is not None:
        first, second, unit = found.groups(default="")
        value = float(first.replace(",", ""))
        if second:
            value /= float(second.replace(",", ""))
    return {
        "benchmark": benchmark,
        "name": row.name,
        "value": value,
        "unit": unit,
        "target": row.required,
        "met": None if row.met is None else bool(row.met),
        "commit": commit,
    }


def update(
    benchmark: str, rows: Sequence[Row], order: Sequence[str], commit: str, file: Path = FILE
) -> None:
    """Write a benchmark's rows into the file, at its position in `order`."""
    old = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    new = [record(benchmark, row, commit) for row in rows]
    records = [it for it in old if it["benchmark"] != benchmark and it["benchmark"] in order] + new
    records.sort(key=lambda it: order.index(it["benchmark"]))
    lines = ",\n".join(json.dumps(it, ensure_ascii=False) for it in records)
    file.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def current_commit() -> str:
    """Return the current commit, with a plus if files differ from it; empty if unknown."""
    said = _git("describe", "--always", "--exclude=*", "--dirty=+")
    return "" if said is None else said.strip()


def changes(file: Path = FILE) -> Iterator[str]:
    """Describe the differences from the committed file, one line per row."""
    committed = _git("show", f"HEAD:./{file.name}", folder=file.parent)
    if committed is None:
        yield f"no {file.name} is committed"
        return
    before = _by_row(json.loads(committed))
    after = _by_row(json.loads(file.read_text(encoding="utf-8")))
    for key in before | after:
        if text := _change(before.get(key), after.get(key)):
            yield f"{key[0]}: {key[1]}: {text}"


def _by_row(records: Sequence[Record]) -> dict[tuple[str, str, int], Record]:
    """Return rows by benchmark, name and, among those of one name, index."""
    found: dict[tuple[str, str, int], Record] = {}
    for it in records:
        place = sum(key[:2] == (it["benchmark"], it["name"]) for key in found)
        found[it["benchmark"], it["name"], place] = it
    return found


def _change(before: Mapping[str, Any] | None, after: Mapping[str, Any] | None) -> str:
    if before is None or after is None:
        return "new" if before is None else "gone"
    old, new = before["value"], after["value"]
    numbers = isinstance(old, float) and isinstance(new, float)
    differ = abs(new - old) > CHANGED * abs(old) if numbers else old != new
    if not differ and before["met"] == after["met"]:
        return ""
    verdict = {True: "met", False: "NOT MET", None: ""}
    ratio = f" ({100.0 * (new / old - 1.0):+.0f} %)" if numbers and old else ""
    unit = f" {after['unit']}" if after["unit"] else ""
    was = f"{verdict[before['met']]} -> " if before["met"] != after["met"] else ""
    return f"{old} -> {new}{unit}{ratio}, {after['target']} {was}{verdict[after['met']]}".rstrip()


def _git(*words: str, folder: Path = FILE.parent) -> str | None:
    done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else None
