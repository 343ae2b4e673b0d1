"""The tables of the documentation's page "how exact": the last results of every benchmark.

Each benchmark has a section: the first line of its docstring as the heading, the rest of the
docstring, the rows, and the date and the versions of the measurement. A run replaces the sections
of the benchmarks that it measures and keeps the others.
"""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

import cv2
from harness.rows import Row, markdown_table

import trisquare as ts

PAGE = Path(__file__).parents[2] / "docs" / "measured.md"

MARK = "<!-- benchmark: {} -->"
SECTION = re.compile(
    r"^<!-- benchmark: ([\w.]+) -->\n(.*?)(?=^<!-- benchmark|\Z)", re.DOTALL | re.M
)


def update(
    name: str, rows: Sequence[Row], order: Sequence[str], conditions: str, page: Path = PAGE
) -> None:
    """Write a benchmark's rows into the page, at its position in `order`.

    Sections of benchmarks that are no longer in `order` are dropped.
    """
    sections = read(page)
    sections[name] = _section(name, rows, conditions)
    page.write_text(
        "\n".join(
            f"{MARK.format(known)}\n{sections[known]}" for known in order if known in sections
        ),
        encoding="utf-8",
    )


def read(page: Path = PAGE) -> dict[str, str]:
    """Return the sections of the page by the names of their benchmarks."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    return {name: f"{body.strip()}\n" for name, body in SECTION.findall(text)}


def conditions() -> str:
    """Return the date, the versions and the machine's load of a measurement."""
    day = datetime.now(timezone.utc).date().isoformat()
    versions = f"{day}: trisquare {ts.__version__}, OpenCV {cv2.__version__}"
    if not hasattr(os, "getloadavg"):
        return versions
    # Times from a busy machine are unreliable, which a reader has to know.
    return f"{versions}; {os.cpu_count()} cores under a load of {os.getloadavg()[0]:.1f}"


def _section(name: str, rows: Sequence[Row], conditions: str) -> str:
    title, _, explanation = (importlib.import_module(name).__doc__ or name).partition("\n")
    explanation = f"{explanation.strip()}\n\n" if explanation else ""
    return (
        f"## {title.rstrip('.')}\n\n{explanation}{markdown_table(rows)}\n\n"
        f"*`benchmarks/{name.replace('.', '/')}.py`, {conditions}*\n"
    )
