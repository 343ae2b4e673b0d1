"""One line of the final table: a measured figure and its target."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


class NotMeasurableError(Exception):
    """Something that a benchmark needs is missing, as the message says. Its last rows stay."""


@dataclass(frozen=True, slots=True)
class Row:
    """A measured figure beside its target; `met` is None without a target."""

    measured_on: str
    measured: str
    must_reach: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """Whether the target is met, as a word."""
        return {True: "yes", False: "**no**", None: ""}[self.met]


def bound_row(name: str, ratio: float, most: float, beside: str = "") -> Row:
    """Return the row of an error over its bound."""
    return Row(name, f"{ratio:.3f}{beside}", f"<= {most:.2f}", ratio <= most)


def coverage_row(name: str, share: float, limits: tuple[float, float]) -> Row:
    """Return the row of the fraction of intervals that contain the truth."""
    low, high = limits
    asked = f"{100 * low:.0f}-{100 * high:.0f} %"
    return Row(name, f"{100 * share:.1f} %", asked, low <= share <= high)


def markdown_table(rows: Iterable[Row]) -> str:
    """Return the rows as a Markdown table."""
    lines = ["| measured on | measured | must reach | met |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {row.measured_on} | {row.measured} | {row.must_reach} | {row.verdict} |" for row in rows
    ]
    return "\n".join(lines)
