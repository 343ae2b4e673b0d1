"""Plots of a report: functions of numbers that return figures."""

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
"""Maximum number of samples drawn one by one: more would only enlarge the file. Means are of all
samples."""

RADIUS_BINS = 12
"""Number of bins over the radius: enough to show the effect of one missing lens coefficient."""

ACROSS = 0.5
"""Minimum cosine between a side's normal and the radius for residuals to count as radial."""

SHOWN_SPREAD = 5.0
"""Range of residuals on a plot, in robust standard deviations; those outside are counted."""

MAX_TICKS = 12
"""Maximum number of planes named along an axis."""

MAP_STEPS = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 7.0])
"""Levels of the uncertainty in every power of ten, with ratios of about 1.5."""

FEWEST_LEVELS = 5
"""Minimum number of such levels; with fewer, evenly spaced levels are used instead."""

MAX_LEVELS = 14
"""Maximum number of levels: more shades could not be matched to the scale by eye."""

NARROW = 8
"""Aspect ratio above which the map is not to scale: that of a line camera would be a line."""

LARGEST_MAPPED = 1e6
"""Uncertainty (px) above which it counts as infinite: it is larger than any picture."""


def residuals_by_side(sides: Sequence[MeasuredSide]) -> Figure:
    """Draw the mean and the spread of each side's residuals, plane by plane."""
    figure, axes = _figure("sides, by plane", "residual, px")
    planes = np.array([side.plane for side in sides])
    order = np.argsort(planes, kind="stable")
    planes = planes[order]
    means = np.array([sides[i].residuals.mean() for i in order])
    spreads = np.array([sides[i].residuals.std() for i in order])
    # One empty place between planes.
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
    """Draw the outward residuals of samples over their distance from the centre.

    Only the samples of sides that run across the radius are used.

    Returns
    -------
    tuple of Figure and int, or None
        The plot and the number of samples beyond its scale; None if no sample is used.
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
    """Draw the radial displacement over the radius, with the radius of the farthest sample.

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
    """Draw the standard deviation of projections over the picture, with the planes.

    Returns
    -------
    Figure or None
        None if there is nothing to draw: a picture too small for a grid, no free parameter, or
        no part within the valid radius.
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
    # Planes of several pictures overlap, and so would their numbers.
    one_picture = len({plane.image for plane in calibration.planes}) == 1
    for number, plane in enumerate(calibration.planes):
        outline = np.vstack([plane.corners, plane.corners[:1]])
        axes.plot(*outline.T, color="black", linewidth=2.2)
        axes.plot(*outline.T, color="white", linewidth=1.0)
        if one_picture:
            x, y = plane.corners.mean(axis=0)
            label = axes.text(x, y, str(number), color="white", ha="center", va="center")
            label.set(clip_on=True, in_layout=False)  # it may be outside the picture
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
