"""A row of a benchmark's table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


class NotMeasurableError(Exception):
    """Something that a benchmark needs is missing, as the message says. Its last rows are kept."""


@dataclass(frozen=True, slots=True)
class Row:
    """A result and the value that is required; `met` is None if none is required."""

    name: str
    result: str
    required: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """Whether the required value is reached, as a word."""
        return {True: "yes", False: "**no**", None: ""}[self.met]


def bound_row(name: str, ratio: float, most: float, remark: str = "") -> Row:
    """Return the row of an error over its bound."""
    return Row(
        f"{name}: error / Cramer-Rao bound", f"{ratio:.3f}{remark}", f"<= {most:.2f}", ratio <= most
    )


def coverage_row(name: str, share: float, limits: tuple[float, float]) -> Row:
    """Return the row of the fraction of intervals that contain the truth."""
    low, high = limits
    required = f"{100 * low:.0f}-{100 * high:.0f} %"
    name = f"{name}: coverage of the 95 % intervals"
    return Row(name, f"{100 * share:.1f} %", required, low <= share <= high)


def markdown_table(rows: Iterable[Row]) -> str:
    """Return the rows as a Markdown table."""
    lines = ["| measurement | result | required | met |", "| --- | --- | --- | --- |"]
    lines += [f"| {row.name} | {row.result} | {row.required} | {row.verdict} |" for row in rows]
    return "\n".join(lines)
