"""The plots, as SVG that follows light and dark: each from the numbers of results.json."""

from __future__ import annotations

import re
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from experiments.estimators import LABELS
from experiments.results import PARAMETERS, Results
from experiments.sweeps import SWEEPS, Sweep

from trisquare.report.plot_style import FAINT, GRID, INK, inline_svg, plane_colour, plotting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ANSWERED = 0.9
"""Share of scenes that an estimator must give a camera for, or its point is left out."""

ORDER = tuple(LABELS)
MARKERS = dict(zip(ORDER, "so^Dv", strict=True))
COLOURS = {name: plane_colour(number) for number, name in enumerate(ORDER)}
UNITS = {name: "% of it" if name == "k1" else "px" for name in PARAMETERS}
WIDTH, HEIGHT = 9.0, 5.4  # inches of 72 points
BAND = 0.18  # opacity
ROUND = 8  # points, of the ground's corners

FOLLOWING = """<style>
{palette}
text {{ font-family: system-ui, "DejaVu Sans", sans-serif; }}
</style>
<rect width="100%" height="100%" rx="{round}" style="fill: var(--ground)"/>
"""


def drawn(found: Results) -> dict[str, str]:
    """Return the plots by the names of their files, without the ending."""
    with plotting():
        figures = {sweep.name: _sweep(sweep, found["sweeps"]) for sweep in SWEEPS}
        figures["corner"] = _corner(found["corner"])
        figures["lengths"] = _lengths(found["lengths"])
        return {name: standalone(figure, name) for name, figure in figures.items()}


def standalone(figure: Figure, name: str) -> str:
    """Return a figure as a picture with its own ground and colours; within `plotting`.

    The colours are those of the report, for light and dark as the reader's system says. The ground
    belongs to them, so that the picture can be read on any page.
    """
    css = (resources.files("trisquare") / "report" / "report.css").read_text(encoding="utf-8")
    palette = css[: css.index("/* Paper")].strip()
    ground = FOLLOWING.format(palette=palette, round=ROUND)
    svg = inline_svg(figure, name).replace(' aria-hidden="true"', "", 1)
    return re.sub(r"(<svg[^>]*>)", lambda start: f"{start[1]}\n{ground}", svg, count=1)


def _figure(rows: int, columns: int, height: float = HEIGHT) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    return figure, list(np.atleast_1d(figure.subplots(rows, columns)).flat)


def _sweep(sweep: Sweep, sweeps: Results) -> Figure:
    """Draw the rms error of every parameter over the levels, with its band, by estimator."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    figure, panels = _figure(2, 3)
    places = dict(
        zip(PARAMETERS, (panels[0], panels[1], panels[3], panels[4], panels[5]), strict=True)
    )
    levels = sweeps[sweep.name]
    for parameter, axes in places.items():
        axes.set_title(f"{parameter}, {UNITS[parameter]}", fontsize=10.0, color=INK)
        for name in ORDER:
            shown = [level for level in levels if is_shown(level.get(name))]
            at = np.array([level["at"] for level in shown])
            if len(shown):
                _curve(axes, name, at, [level[name][parameter] for level in shown])
            elif name == "boards":
                _level_line(axes, sweep, sweeps["noise"][0][name][parameter])
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        if sweep.logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        else:
            axes.set_xticks(sweep.levels)
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_locator(NullLocator())
    figure.supxlabel(sweep.axis, fontsize=10.0, color=INK)
    _legend(panels[2], places["k1"])
    return figure


def is_shown(point: Results | None) -> bool:
    """Whether an estimator answered for enough of a level's scenes."""
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


def _level_line(axes: Axes, sweep: Sweep, point: Results) -> None:
    """Draw what does not change with the level, as it is at the sweeps' common noise."""
    colour = COLOURS["boards"]
    axes.axhspan(point["low"], point["high"], color=colour, alpha=BAND, linewidth=0.0)
    axes.axhline(point["rms"], color=colour, linewidth=1.4, linestyle="--", label=LABELS["boards"])


def _legend(panel: Axes, of: Axes) -> None:
    panel.axis("off")
    panel.legend(*of.get_legend_handles_labels(), loc="center", frameon=False, fontsize=9.0)


def _corner(found: Results) -> Figure:
    """Draw every scene's error from the corner over that from the boards."""
    figure, (axes,) = _figure(1, 1, 4.2)
    boards = np.array(found["by_scene"][found["better"]])
    corner = np.array(found["by_scene"]["corner"])
    ends = np.array([0.6 * min(boards.min(), corner.min()), 1.6 * max(boards.max(), corner.max())])
    axes.plot(ends, ends, color=FAINT, linewidth=1.0)
    axes.plot(ends, 0.6 * ends, color=GRID, linewidth=1.4, linestyle="--")
    axes.annotate("equal", (ends[1], ends[1]), color=INK, ha="right", va="top", fontsize=9.0)
    axes.annotate("0.6", (ends[1], 0.6 * ends[1]), color=INK, ha="right", va="top", fontsize=9.0)
    axes.scatter(boards, corner, s=26.0, c=COLOURS["pixels"], zorder=3)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("13 photographs of a board, Zhang: error, px")
    axes.set_ylabel("one photograph of the corner: error, px")
    return figure


def _lengths(found: Results) -> Figure:
    """Draw the rms error of lengths by camera, with its interval."""
    sets = [(title, found[name]) for name, title in LENGTH_SETS.items() if found[name]]
    figure, panels = _figure(1, len(sets), 2.6)
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
        axes.set_xscale("log")
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
