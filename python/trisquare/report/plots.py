"""The plots of a report: each takes numbers and returns a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trisquare._support.arrays import NORMAL_MEDIAN, FloatArray
from trisquare.analysis.comparison import two_digits
from trisquare.report.lens import radial_displacement
from trisquare.report.plot_style import FAINT, GROUND, INK, PLOT_HEIGHT, PLOT_WIDTH, plane_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from trisquare.analysis.residuals import MeasuredSide
    from trisquare.camera.camera import Camera
    from trisquare.camera.projection_uncertainty import ProjectionMap
    from trisquare.results.calibration import Calibration

MAX_DOTS = 1500
"""Samples drawn one by one: more would only make the file larger, the means are of all."""

RADIUS_BINS = 12
"""Enough to show the bend that one missing coefficient of the lens leaves."""

ACROSS = 0.5
"""Cosine between a side's normal and the radius from which its residual tells of the radius."""

SHOWN_SPREAD = 5.0
"""Robust standard deviations of residuals on a plot; those beyond are counted instead."""

MAX_TICKS = 12
"""Planes named along an axis."""

MAP_STEPS = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 7.0])
"""Levels of the uncertainty in every power of ten, each about half as much again as the last."""

FEWEST_LEVELS = 5
"""With fewer of those, levels are spread evenly."""

MAX_LEVELS = 14
"""Shades that an eye can follow from the map to its scale."""

NARROW = 8
"""Times as long as wide: a line camera's picture, whose map would be a line as well."""

LARGEST_MAPPED = 1e6
"""Pixels: an uncertainty beyond any picture's size is as good as infinite."""


def residuals_by_side(sides: Sequence[MeasuredSide]) -> Figure:
    """Draw each side's mean residual and the spread about it, plane by plane."""
    figure, axes = _figure("sides, by plane", "residual, px")
    planes = np.array([side.plane for side in sides])
    order = np.argsort(planes, kind="stable")
    planes = planes[order]
    means = np.array([sides[i].residuals.mean() for i in order])
    spreads = np.array([sides[i].residuals.std() for i in order])
    # A gap of one between planes.
    numbers = np.unique(planes)
    places = np.arange(len(order)) + np.searchsorted(numbers, planes)
    colours = [plane_colour(plane) for plane in planes.tolist()]
    axes.axhline(0.0, color=FAINT, linewidth=1.0)
    axes.vlines(places, means - spreads, means + spreads, colors=colours, linewidth=2.5, alpha=0.45)
    axes.scatter(places, means, s=16.0, c=colours, zorder=3)
    middles = [places[planes == number].mean() for number in numbers]
    every = -(-len(numbers) // MAX_TICKS)
    axes.set_xticks(middles[::every], [str(number) for number in numbers[::every]])
    axes.grid(visible=False, axis="x")
    return figure


def residuals_by_radius(
    calibration: Calibration, sides: Sequence[MeasuredSide]
) -> tuple[Figure, int] | None:
    """Draw how far samples lie outward of the model, over the distance from the centre.

    Only the samples of sides that run across the radius tell.

    Returns
    -------
    tuple of Figure and int, or None
        The plot and how many samples lie beyond its scale; None if no sample tells.
    """
    centre = np.array([calibration.camera.cx, calibration.camera.cy])
    rows = [np.empty((0, 3))]
    for side in sides:
        arms = side.points - centre
        radii = np.maximum(np.linalg.norm(arms, axis=1), 1e-9)
        cosine = (arms * side.normals).sum(axis=1) / radii
        values = side.residuals * np.sign(cosine)
        across = np.abs(cosine) > ACROSS
        rows.append(np.column_stack([radii, values, np.full(len(radii), side.plane)])[across])
    radius, outward, planes = np.vstack(rows).T
    if len(radius) == 0:
        return None
    figure, axes = _figure("distance from the principal point, px", "outward residual, px")
    shown = slice(None, None, -(-len(radius) // MAX_DOTS))
    colours = [plane_colour(int(plane)) for plane in planes[shown]]
    axes.axhline(0.0, color=FAINT, linewidth=1.0)
    axes.scatter(radius[shown], outward[shown], s=5.0, c=colours, alpha=0.4, linewidths=0.0)
    groups = np.array_split(np.argsort(radius), min(RADIUS_BINS, -(-len(radius) // 8)))
    means = np.array([outward[group].mean() for group in groups])
    errors = [outward[group].std() / np.sqrt(len(group)) for group in groups]
    middles = [radius[group].mean() for group in groups]
    axes.errorbar(middles, means, yerr=errors, color=INK, linewidth=1.5, marker="o", markersize=4.0)
    spread = float(np.median(np.abs(outward))) / NORMAL_MEDIAN
    reach = max(SHOWN_SPREAD * spread, 1.3 * float(np.abs(means).max()), 1e-9)
    axes.set_ylim(-reach, reach)
    return figure, int((np.abs(outward) > reach).sum())


def displacement_by_radius(camera: Camera, sides: Sequence[MeasuredSide]) -> Figure | None:
    """Draw the radial displacement over the radius, and where the farthest sample lies.

    Returns
    -------
    Figure or None
        None if the lens has no radial distortion.
    """
    curve = radial_displacement(camera)
    if curve is None:
        return None
    figure, axes = _figure("distance from the principal point, px", "displacement outward, px")
    axes.axhline(0.0, color=FAINT, linewidth=1.0)
    axes.plot(*curve, color=INK, linewidth=1.8)
    centre = np.array([camera.cx, camera.cy])
    radii = [np.linalg.norm(side.points - centre, axis=1).max() for side in sides]
    if radii:
        axes.axvline(max(radii), color=FAINT, linewidth=1.2, linestyle="--")
    return figure


def uncertainty_map(calibration: Calibration, known: ProjectionMap) -> Figure | None:
    """Draw how far the projection of a direction may be off, over the picture, and the planes.

    Returns
    -------
    Figure or None
        None where nothing is to be drawn: a picture too small for a grid, no free parameter, or
        nothing known at all.
    """
    std = np.ma.masked_array(known.std, ~(known.std < LARGEST_MAPPED))
    if min(std.shape) < 2 or std.count() == 0 or not std.max() > 0.0:
        return None
    figure, axes = _figure("x, px", "y, px")
    levels = _levels(float(std.min()), float(std.max()))
    drawn = axes.contourf(known.x, known.y, std, levels=levels, cmap="viridis", extend="both")
    bar = figure.colorbar(drawn, ax=axes, label="px", shrink=0.9)
    bar.outline.set_visible(False)  # type: ignore[operator]  # the stubs take it for a function
    bar.set_ticks(levels.tolist(), labels=[two_digits(level) for level in levels])
    # Planes of several pictures lie over each other, and so would their numbers.
    one_picture = len({plane.image for plane in calibration.planes}) == 1
    for number, plane in enumerate(calibration.planes):
        outline = np.vstack([plane.corners, plane.corners[:1]])
        axes.plot(*outline.T, color="black", linewidth=2.2)
        axes.plot(*outline.T, color="white", linewidth=1.0)
        if one_picture:
            x, y = plane.corners.mean(axis=0)
            label = axes.text(x, y, str(number), color="white", ha="center", va="center")
            label.set(clip_on=True, in_layout=False)  # it may stand outside the picture
    width, height = calibration.camera.image_size
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    if max(width, height) < NARROW * min(width, height):
        axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_facecolor(GROUND)
    return figure


def _levels(low: float, high: float) -> FloatArray:
    """Return round levels between two positive numbers, at least two."""
    low = max(low, 1e-3 * high)
    powers = np.arange(np.floor(np.log10(low)) - 1, np.ceil(np.log10(high)) + 1)
    ladder = np.outer(10.0**powers, MAP_STEPS).ravel()
    levels = ladder[(ladder > low) & (ladder < high)]
    if len(levels) < FEWEST_LEVELS:
        from matplotlib.ticker import MaxNLocator

        levels = np.asarray(MaxNLocator(nbins=7).tick_values(low, high))
        levels = np.unique(levels[levels > 0.0])
        return levels if len(levels) > 1 else np.array([0.5, 1.0]) * high
    return levels[:: -(-len(levels) // MAX_LEVELS)]


def _figure(xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PLOT_WIDTH, PLOT_HEIGHT))
    return figure, figure.add_subplot(xlabel=xlabel, ylabel=ylabel)
