"""Where the camera stands relative to the squares, sketched in three dimensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

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

AZIMUTH, ELEVATION = np.radians(40.0), np.radians(24.0)
"""From where the oblique view looks, beside and above the camera's own line of sight."""

PYRAMID = 0.3
"""Length of the camera's pyramid over the distance of the nearest plane."""


class View(NamedTuple):
    """A parallel projection: directions of the camera's frame that run right, down and away."""

    right: FloatArray
    down: FloatArray
    away: FloatArray

    @classmethod
    def along(cls, away: FloatArray, right: FloatArray) -> View:
        """Return the view that looks along a direction."""
        return cls(right, np.cross(away, right), away)

    def flat(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) as they are drawn, (N, 2), x right and y up."""
        return np.column_stack([points @ self.right, -points @ self.down])


OBLIQUE = View.along(
    away=np.array(
        [
            -np.sin(AZIMUTH) * np.cos(ELEVATION),
            np.sin(ELEVATION),
            np.cos(AZIMUTH) * np.cos(ELEVATION),
        ]
    ),
    right=np.array([np.cos(AZIMUTH), 0.0, np.sin(AZIMUTH)]),
)
FROM_ABOVE = View.along(away=np.array([0.0, 1.0, 0.0]), right=np.array([1.0, 0.0, 0.0]))


class StandingFigure(NamedTuple):
    """A plane's first figure: its number and its corners (4, 3) in the camera's frame."""

    number: int
    corners: FloatArray


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
        StandingFigure(number, corners)
        for number, plane in enumerate(calibration.planes)
        if plane.image == image and (corners := _corners(plane, calibration.camera)) is not None
    ]
    if not figures:
        return None
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PLOT_WIDTH, SKETCH_HEIGHT))
    for place, (title, view) in enumerate([("from the side", OBLIQUE), ("from above", FROM_ABOVE)]):
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


def _draw(axes: Axes, camera: Camera, figures: list[StandingFigure], view: View) -> None:
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    floor = max(0.0, *(float(figure.corners[:, 1].max()) for figure in figures))
    nearest = min(float(np.linalg.norm(figure.corners.mean(axis=0))) for figure in figures)
    oblique = view is OBLIQUE
    for number, corners in sorted(
        figures, key=lambda f: -float(f.corners.mean(axis=0) @ view.away)
    ):
        centre = corners.mean(axis=0)
        if oblique:  # shadows tell how high and how far away things are
            on_floor = corners * [1.0, 0.0, 1.0] + [0.0, floor, 0.0]
            axes.fill(*view.flat(on_floor).T, facecolor=GRID, edgecolor="none", alpha=0.6)
            drop = np.array([centre, centre * [1.0, 0.0, 1.0] + [0.0, floor, 0.0]])
            axes.plot(*view.flat(drop).T, color=FAINT, linewidth=0.7, linestyle=":")
        ray = view.flat(np.array([np.zeros(3), centre]))
        axes.plot(*ray.T, color=FAINT, linewidth=0.7, linestyle="--")
        colour, outline = plane_colour(number), view.flat(corners)
        axes.fill(*outline.T, facecolor=colour, edgecolor="none", alpha=0.35)
        axes.plot(*np.vstack([outline, outline[:1]]).T, color=colour, linewidth=1.6)
        x, y = ray[1]
        axes.text(x, y, str(number), color=INK, ha="center", va="center")
    _draw_camera(axes, camera, view, PYRAMID * nearest)
    if oblique:
        foot = np.array([[0.0, 0.0, 0.0], [0.0, floor, 0.0]])
        axes.plot(*view.flat(foot).T, color=FAINT, linewidth=0.7, linestyle=":")


def _draw_camera(axes: Axes, camera: Camera, view: View, length: float) -> None:
    """Draw the pyramid that the picture spans, without the lens's bend."""
    width, height = camera.image_size
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) - [
        0.5,
        0.5,
        0,
    ]
    rays = pixels @ np.linalg.inv(camera.K).T
    base = view.flat(rays * length / np.linalg.norm(rays, axis=1).max())
    tip = view.flat(np.zeros((1, 3)))[0]
    for corner in base:
        axes.plot(*np.array([tip, corner]).T, color=INK, linewidth=1.2)
    axes.plot(*np.vstack([base, base[:1]]).T, color=INK, linewidth=1.2)
    # The picture's upper side is drawn thicker.
    axes.plot(*base[:2].T, color=INK, linewidth=2.6)
    axes.text(tip[0], tip[1], "camera ", color=INK, ha="right", va="top")
