"""One line of the final table: what was measured, and what it must reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """A measured figure beside its target; `met` is None where there is none."""

    measured_on: str
    measured: str
    must_reach: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """Whether the target is met, in a word."""
        return {True: "yes", False: "**no**", None: ""}[self.met]


def markdown_table(rows: Iterable[Row]) -> str:
    """Return the rows as a Markdown table."""
    lines = ["| measured on | measured | must reach | met |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {row.measured_on} | {row.measured} | {row.must_reach} | {row.verdict} |" for row in rows
    ]
    return "\n".join(lines)
