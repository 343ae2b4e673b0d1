"""The page of a batch: one HTML file that opens anywhere, offline."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup

from trisquare._support.html_pages import page_environment
from trisquare._support.number_text import with_its_std
from trisquare.batch.fleet import CHANCE, FEWEST, Distribution, Fleet
from trisquare.batch.requirements import PARAMETERS, AnyRequirement
from trisquare.batch.summary import Counts

MAX_SHOWN = 200
"""Maximum number of cameras in each list: a page of thousands would not open. The table has all."""

BARS = 31
REACH = 5.0
"""Half the range of a histogram about the median, in standard deviations of the fleet; values
outside are counted in the outermost bars."""

WIDTH, HEIGHT = 310, 60
"""Size of a histogram, in units of its own."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A distribution in the form shown on the page."""

    kind: str
    name: str
    count: int
    median: str
    spread: str
    median_std: str
    low: str
    high: str
    path: str


def summary_page(
    rows: Iterable[Mapping[str, Any]],
    fleet: Fleet,
    counts: Counts,
    requirements: Sequence[AnyRequirement],
) -> bytes:
    """Return the page in UTF-8; it depends only on the arguments."""
    beyond: list[Mapping[str, Any]] = []
    outlying: list[Mapping[str, Any]] = []
    retake: list[Mapping[str, Any]] = []
    mistaken: list[Mapping[str, Any]] = []
    mistakes = 0
    for row in rows:
        for kept, column in ((beyond, "beyond_limits"), (outlying, "outlying"), (retake, "retake")):
            if row.get(column) and len(kept) < MAX_SHOWN:
                kept.append(row)
        if row.get("failure") and not row["retake"]:
            mistakes += 1
            if len(mistaken) < MAX_SHOWN:
                mistaken.append(row)
    environment = page_environment("trisquare.batch")
    style = (resources.files("trisquare.report") / "report.css").read_text("utf-8")
    ordered = sorted(
        fleet.distributions.values(),
        key=lambda distribution: (distribution.kind, PARAMETERS.index(distribution.parameter)),
    )
    page: str = environment.get_template("summary.html.j2").render(
        counts=counts,
        requirements=requirements,
        distributions=[_shown(distribution) for distribution in ordered],
        beyond=beyond,
        outlying=outlying,
        retake=retake,
        mistaken=mistaken,
        mistakes=mistakes,
        fewest=FEWEST,
        chance=f"{100 * CHANCE:.0f} %",
        width=WIDTH,
        height=HEIGHT,
        style=Markup(style),
    )
    return page.encode("utf-8", "backslashreplace")


def _shown(own: Distribution) -> Shown:
    scale = float(np.hypot(own.spread, own.median_std))
    reach = REACH * scale or 1.0
    clipped = np.clip(own.values, own.median - reach, own.median + reach)
    heights, _ = np.histogram(clipped, BARS, (own.median - reach, own.median + reach))
    unit = HEIGHT / max(1, int(heights.max()))
    step = WIDTH / BARS
    path = "".join(
        f"M{number * step:.1f} {HEIGHT}v{-unit * count:.1f}h{step - 1:.1f}v{unit * count:.1f}z"
        for number, count in enumerate(heights.tolist())
        if count
    )
    median, spread = with_its_std(own.median, scale)
    return Shown(
        own.kind,
        own.parameter,
        len(own.values),
        median,
        spread if own.spread == scale else with_its_std(own.spread, scale)[0],
        f"{own.median_std:.2g}",
        f"{own.values.min():.6g}",
        f"{own.values.max():.6g}",
        path,
    )
