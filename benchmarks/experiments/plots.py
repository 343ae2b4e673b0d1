"""The plots, as SVG in the reader's light or dark colours, from the numbers of results.json."""

from __future__ import annotations

import re
from importlib import resources
from typing import TYPE_CHECKING, Literal

import numpy as np
from experiments.estimators import LABELS
from experiments.printed_corner import SHEETS, TARGET
from experiments.results import PARAMETERS, Results
from experiments.sweeps import SWEEPS, Sweep

from trisquare.report.plot_style import FAINT, INK, inline_svg, plane_colour, plotting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ANSWERED = 0.9
"""Minimum fraction of scenes with a camera from an estimator; otherwise its point is left out."""

ORDER = tuple(LABELS)
MARKERS = dict(zip(ORDER, "so^Dv", strict=True))
COLOURS = {name: plane_colour(number) for number, name in enumerate(ORDER)}
UNITS = {name: "% of it" if name == "k1" else "px" for name in PARAMETERS}
WIDTH, HEIGHT = 9.0, 5.4  # inches of 72 points
BAND = 0.18  # opacity
ROUND = 8  # points: radius of the corners of the background

NEEDLESS = (
    r"\s*<!--.*?-->",
    r"(?<=\n) +",
    r' transform="rotate\(-0 [^"]*"',
    r'(?<=<g) id="[^"]*"',
    r"; stroke-line(join: miter|cap: square)",
    r"xlink:(?=href)",
)
"""Needless parts of matplotlib's SVG: comments, indents, zero rotations, unused ids, defaults."""

FOLLOWING = """<style>
{palette}
text {{ font-family: system-ui, "DejaVu Sans", sans-serif; }}
</style>
<rect width="100%" height="100%" rx="{round}" style="fill: var(--ground)"/>
"""


def drawn(found: Results) -> dict[str, str]:
    """Return the plots by file name without extension."""
    with plotting():
        figures = {sweep.name: _sweep(sweep, found["sweeps"]) for sweep in SWEEPS}
        figures["corner"] = _corner(found["corner"])
        figures["lengths"] = _lengths(found["lengths"])
        return {name: standalone(figure, name) for name, figure in figures.items()}


def standalone(figure: Figure, name: str) -> str:
    """Return a figure as a picture with its own background and colours; call within `plotting`.

    The colours are those of the report, light or dark as the reader's system prefers. The
    background is one of them, so that the picture is readable on any page.
    """
    css = (resources.files("trisquare") / "report" / "report.css").read_text(encoding="utf-8")
    on_screen = css[: css.index("@media print")]
    palette = re.sub(r"/\*.*?\*/", "", on_screen).strip()
    ground = FOLLOWING.format(palette=palette, round=ROUND)
    svg = inline_svg(figure, name).replace(' aria-hidden="true"', "", 1)
    # A tenth of a point is invisible, and the needless parts are half of the file.
    svg = re.sub(r"\d+\.\d{3,}(?=[^<>]*>)", lambda number: f"{float(number[0]):.1f}", svg)
    for needless in NEEDLESS:
        svg = re.sub(needless, "", svg)
    svg = re.sub(r" ?\n(?=[LMzQC\"])", " ", svg)
    return re.sub(r"(<svg[^>]*>)", lambda start: f"{start[1]}\n{ground}", svg, count=1)


def _figure(rows: int, columns: int, height: float = HEIGHT) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    panels = list(np.atleast_1d(figure.subplots(rows, columns)).flat)
    for axes in panels:
        axes.tick_params(bottom=False, left=False)
        axes.grid(clip_on=False)
    return figure, panels


def _sweep(sweep: Sweep, sweeps: Results) -> Figure:
    """Draw the rms error of every parameter over the levels, with its interval, by estimator."""
    figure, panels = _figure(2, 3)
    legend = panels.pop(2)
    for axes in panels[1:4]:  # of the four in pixels
        axes.sharey(panels[0])
    levels = sweeps[sweep.name]
    for parameter, axes in zip(PARAMETERS, panels, strict=True):
        axes.set_title(f"{parameter}, {UNITS[parameter]}", fontsize=10.0, color=INK)
        for name in ORDER:
            shown = [level for level in levels if is_shown(level.get(name))]
            at = np.array([level["at"] for level in shown])
            if len(shown):
                _curve(axes, name, at, [level[name][parameter] for level in shown])
            elif name == "boards" and is_shown(sweeps["noise"][0].get(name)):
                _level_line(axes, sweeps["noise"][0][name][parameter])
        if sweep.logarithmic:
            _plain_log(axes, "x")
        else:
            axes.set_xticks(sweep.levels, [f"{level:g}" for level in sweep.levels])
        _plain_log(axes, "y")
    figure.supxlabel(sweep.axis, fontsize=10.0, color=INK)
    legend.axis("off")
    legend.legend(
        *panels[-1].get_legend_handles_labels(), loc="center", frameon=False, fontsize=9.0
    )
    return figure


def _plain_log(axes: Axes, name: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with numbers at 1 and 3 of each power of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set(**{f"{name}scale": "log"})
    axis = axes.xaxis if name == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def is_shown(point: Results | None) -> bool:
    """Return whether an estimator answered for enough of a level's scenes."""
    return bool(point) and point["answered"] >= ANSWERED * point["scenes"]


def _curve(axes: Axes, name: str, at: np.ndarray, points: list[Results]) -> None:
    low, middle, high = ([point[key] for point in points] for key in ("low", "rms", "high"))
    colour = COLOURS[name]
    axes.fill_between(at, low, high, color=colour, alpha=BAND, linewidth=0.0)
    axes.plot(
        at,
        middle,
        color=colour,
        marker=MARKERS[name],
        markersize=4.0,
        linewidth=1.4,
        label=LABELS[name],
    )


def _level_line(axes: Axes, point: Results) -> None:
    """Draw a result that does not depend on the level, at the common noise of the sweeps."""
    colour = COLOURS["boards"]
    axes.axhspan(point["low"], point["high"], color=colour, alpha=BAND, linewidth=0.0)
    axes.axhline(point["rms"], color=colour, linewidth=1.4, linestyle="--", label=LABELS["boards"])


def _corner(found: Results) -> Figure:
    """Draw every camera's error from one photograph of a corner over that from the boards."""
    figure, (axes,) = _figure(1, 1, 4.2)
    boards = np.array(found["by_scene"][found["better"]])
    corners = {sheet: np.array(found["by_scene"][sheet]) for sheet in SHEETS}
    ends = np.array([0.7 * boards.min(), 1.4 * boards.max()])
    for factor, style in ((1.0, "-"), (TARGET, "--")):
        axes.plot(ends, factor * ends, color=FAINT, linewidth=1.2, linestyle=style)
        axes.annotate(
            f" {factor:g} times", (ends[1], factor * ends[1]), color=INK, va="center", fontsize=9.0
        )
    for (sheet, own), name in zip(corners.items(), ("edges", "pixels"), strict=True):
        marks = {"c": COLOURS[name], "marker": MARKERS[name], "label": f"corner of three {sheet}"}
        axes.scatter(boards, own, s=26.0, zorder=3, **marks)
    _plain_log(axes, "x")
    _plain_log(axes, "y")
    axes.set_xlim(ends[0], 1.3 * ends[1])
    axes.set_xlabel("13 photographs of a board, Zhang: error, px")
    axes.set_ylabel("one photograph of a corner: error, px")
    axes.legend(loc="lower right", frameon=False, fontsize=9.0)
    return figure


def _lengths(found: Results) -> Figure:
    """Draw the rms error of lengths by camera, with its interval."""
    sets = [(title, found[name]) for name, title in LENGTH_SETS.items() if found[name]]
    figure, panels = _figure(1, len(sets), 2.6)
    for axes in panels[1:]:
        axes.sharex(panels[0])
    for axes, (title, cameras) in zip(panels, sets, strict=True):
        names = [name for name in (*ORDER, "truth") if name in cameras]
        for place, name in enumerate(reversed(names)):
            point = cameras[name]
            colour = COLOURS.get(name, INK)
            low, middle, high = (0.01 * point[key] for key in ("low", "rms", "high"))
            axes.plot([low, high], [place, place], color=colour, linewidth=5.0, alpha=0.4)
            axes.plot(
                [middle], [place], color=colour, marker=MARKERS.get(name, "|"), markersize=7.0
            )
        axes.set_yticks(range(len(names)), [SHORT[name] for name in reversed(names)])
        axes.set_ylim(-0.6, len(names) - 0.4)
        axes.set_title(title, fontsize=10.0, color=INK)
        _plain_log(axes, "x")
        axes.set_xlabel("rms error of lengths, %")
    return figure


LENGTH_SETS = {"simulated": "simulated planes", "real": "real chessboards"}
SHORT = {
    "linear": "linear steps",
    "edges": "ML, edge points",
    "pixels": "ML, pixels",
    "corners": "Zhang, the squares' corners",
    "boards": "Zhang, 13 boards",
    "truth": "the true camera",
}
