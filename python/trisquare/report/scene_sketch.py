"""Where the camera stands relative to the squares, sketched in three dimensions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.analysis.plan import onto_plane
from trisquare.report.plot_style import FAINT, GRID, INK, PLOT_WIDTH, plane_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from trisquare.camera.camera import Camera
    from trisquare.results.calibration import Calibration
    from trisquare.results.plane import Plane

SKETCH_HEIGHT = 2.7
"""Inches: two views side by side are wider than they are high."""

PYRAMID = 0.3
"""Length of the camera's pyramid over the distance of the nearest plane."""


def _view(azimuth: float, elevation: float) -> FloatArray:
    """Return a parallel projection that looks from beside and above the camera, by so many degrees.

    Its rows are the directions of the camera's frame that run right, down and away.
    """
    beside, above = np.radians([azimuth, elevation])
    right = [np.cos(beside), 0.0, np.sin(beside)]
    level = np.array([-np.sin(beside), 0.0, np.cos(beside)])
    away = np.cos(above) * level + [0.0, np.sin(above), 0.0]
    return np.array([right, np.cross(away, right), away])


FROM_THE_SIDE, FROM_ABOVE = _view(40.0, 24.0), _view(0.0, 90.0)


def scene_sketch(calibration: Calibration, image: int) -> Figure | None:
    """Draw camera and squares of one picture obliquely and from above.

    Each square's own side is the unit: their true sizes are not known, and one that is twice as
    large stands twice as far away in the same direction.

    Returns
    -------
    Figure or None
        None if the picture has no plane that stands before the camera.
    """
    figures = [
        (number, corners)
        for number, plane in enumerate(calibration.planes)
        if plane.image == image and (corners := _corners(plane, calibration.camera)) is not None
    ]
    if not figures:
        return None
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PLOT_WIDTH, SKETCH_HEIGHT))
    for place, (title, view) in enumerate(
        [("from the side", FROM_THE_SIDE), ("from above", FROM_ABOVE)]
    ):
        axes = figure.add_subplot(1, 2, place + 1)
        _draw(axes, calibration.camera, figures, view)
        axes.set_title(title, fontsize=10.0, color=FAINT)
    return figure


def _corners(plane: Plane, camera: Camera) -> FloatArray | None:
    """Return where a plane's corners stand; None if they do not stand before the camera."""
    try:
        flat = onto_plane(plane.corners, camera, plane)
    except ValueError:
        return None
    corners = flat @ plane.rotation[:, :2].T + plane.translation
    return corners if np.all(corners[:, 2] > 0.0) else None


def _flat(view: FloatArray, points: FloatArray) -> FloatArray:
    """Return points (N, 3) as they are drawn, (N, 2), x right and y up."""
    return points @ view[:2].T * [1.0, -1.0]


def _draw(
    axes: Axes, camera: Camera, figures: list[tuple[int, FloatArray]], view: FloatArray
) -> None:
    """Draw the camera and figures: each its number and its corners (4, 3) in the camera's frame."""
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    floor = max(0.0, *(float(corners[:, 1].max()) for _, corners in figures))
    nearest = min(float(np.linalg.norm(corners.mean(axis=0))) for _, corners in figures)

    def fill(points: FloatArray, colour: str, alpha: float) -> None:
        axes.fill(*_flat(view, points).T, facecolor=colour, edgecolor="none", alpha=alpha)

    def line(points: FloatArray, colour: str, width: float, style: str = "-") -> None:
        axes.plot(*_flat(view, points).T, color=colour, linewidth=width, linestyle=style)

    def on_floor(points: FloatArray) -> FloatArray:
        return points * [1.0, 0.0, 1.0] + [0.0, floor, 0.0]

    origin = np.zeros(3)
    for number, corners in sorted(figures, key=lambda f: -float(f[1].mean(axis=0) @ view[2])):
        centre, colour = corners.mean(axis=0), plane_colour(number)
        if view is FROM_THE_SIDE:  # shadows tell how high and how far away things are
            fill(on_floor(corners), GRID, 0.6)
            line(np.array([centre, on_floor(centre)]), FAINT, 0.7, ":")
        line(np.array([origin, centre]), FAINT, 0.7, "--")
        fill(corners, colour, 0.35)
        line(np.vstack([corners, corners[:1]]), colour, 1.6)
        x, y = _flat(view, centre)
        axes.text(x, y, str(number), color=INK, ha="center", va="center")
    # The camera is the pyramid that the picture spans, without the lens's bend.
    width, height = camera.image_size
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    rays = np.column_stack([pixels, np.ones(4)]) @ np.linalg.inv(camera.K).T
    base = rays * PYRAMID * nearest / np.linalg.norm(rays, axis=1).max()
    for corner in base:
        line(np.array([origin, corner]), INK, 1.2)
    line(np.vstack([base, base[:1]]), INK, 1.2)
    line(base[:2], INK, 2.6)  # the picture's upper side
    axes.text(0.0, 0.0, "camera ", color=INK, ha="right", va="top")
    if view is FROM_THE_SIDE:
        line(np.array([origin, on_floor(origin)]), FAINT, 0.7, ":")
