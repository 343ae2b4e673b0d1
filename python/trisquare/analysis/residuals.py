"""Where a calibration says that the measured edges should be, and how far off they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.analysis.plane_points import onto_plane
from trisquare.camera.camera import Camera
from trisquare.edges import PlaneEdges
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

# Chords of this length stay within 1e-3 px of a curve of radius 125 px; no lens bends so much.
CHORD_PX = 1.0

MOST_CHORDS = 32768
"""A side is no longer than a picture; only a pose that contradicts its samples has longer ones."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredSide:
    """One measured line of a figure with the signed distances of its samples to the model.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        The samples, in pixels.
    curve : ndarray, shape (M, 2)
        The model's line projected through lens and pose, densely, in pixels.
    residuals : ndarray, shape (N,)
        Signed distance of each sample from the curve, in pixels, positive along `normals`.
    normals : ndarray, shape (N, 2)
        Unit normal of the curve at each sample.
    plane : int
        Which of the calibration's planes it lies on.
    """

    points: FloatArray
    curve: FloatArray
    residuals: FloatArray
    normals: FloatArray
    plane: int


def measured_sides(
    calibration: Calibration, edges: Sequence[PlaneEdges], image: int = 0
) -> Iterator[MeasuredSide]:
    """Compare the samples of one picture with the calibrated model.

    Figures are matched to the calibration's planes by their place in the picture; a figure that
    belongs to none of them is passed over. On a shared plane, the size and place of every figure
    are those that suit its samples best, as results do not tell them.

    Parameters
    ----------
    calibration : Calibration
        The camera and the planes.
    edges : sequence of PlaneEdges
        What was measured.
    image : int
        Index of the picture.

    Yields
    ------
    MeasuredSide
        For each line of each matched figure.
    """
    plane_of_group: dict[int, Plane | None] = {}
    for figure in edges:
        if figure.image != image:
            continue
        first_of_plane = figure.plane is None or figure.plane not in plane_of_group
        plane = (
            _plane_around(calibration.planes, figure)
            if figure.plane is None or first_of_plane
            else plane_of_group[figure.plane]
        )
        if figure.plane is not None:
            plane_of_group[figure.plane] = plane
        if plane is None:
            continue
        number = next(n for n, other in enumerate(calibration.planes) if other is plane)
        on_plane = [onto_plane(points, calibration.camera, plane) for points in figure.points]
        fixed = first_of_plane or figure.freedom == "fixed"
        lines = figure.lines if fixed else _placed_lines(figure.lines, on_plane)
        for points, line, foot_points in zip(figure.points, lines, on_plane, strict=True):
            curve = _projected_line(line, foot_points, calibration.camera, plane)
            yield _compare(points, curve, number)


def project(camera: Camera, plane: Plane, points: FloatArray) -> FloatArray:
    """Project points of a plane's frame, shape (N, 3), into the photograph, shape (N, 2)."""
    rotation_vector = cv2.Rodrigues(np.array(plane.rotation))[0]
    projected = cv2.projectPoints(
        np.ascontiguousarray(points, dtype=np.float64),
        rotation_vector,
        np.array(plane.translation),
        np.array(camera.K),
        np.array(camera.distortion),
    )[0]
    return np.asarray(projected, dtype=np.float64).reshape(-1, 2)


def _plane_around(planes: Sequence[Plane], figure: PlaneEdges) -> Plane | None:
    """Find the plane whose first figure surrounds the centre of this one."""
    centre = np.vstack(figure.points).mean(axis=0)
    nearest, nearest_distance = None, np.inf
    for plane in planes:
        plane_centre = plane.corners.mean(axis=0)
        reach = np.linalg.norm(plane.corners - plane_centre, axis=1).min()
        distance = float(np.linalg.norm(centre - plane_centre))
        if plane.image == figure.image and distance < min(reach, nearest_distance):
            nearest, nearest_distance = plane, distance
    return nearest


def _placed_lines(lines: FloatArray, on_plane: Sequence[FloatArray]) -> FloatArray:
    """Move a figure's lines by the similarity of the plane that suits its samples best.

    The similarity that takes a point of the plane into the figure's frame,
    ``(p x - q y + u, q x + p y + v)``, is linear in its four unknowns, and so are the samples'
    distances from their lines.
    """
    rows, constants = [], []
    for (a, b, c), samples in zip(lines, on_plane, strict=True):
        x, y = samples.T
        ones = np.ones_like(x)
        rows.append(np.column_stack([a * x + b * y, b * x - a * y, a * ones, b * ones]))
        constants.append(-c * ones)
    p, q, u, v = np.linalg.lstsq(np.vstack(rows), np.concatenate(constants), rcond=None)[0]
    figure_from_plane = np.array([[p, -q, u], [q, p, v], [0.0, 0.0, 1.0]])
    return np.asarray(lines @ figure_from_plane, dtype=np.float64)


def _projected_line(
    line: FloatArray, on_plane: FloatArray, camera: Camera, plane: Plane
) -> FloatArray:
    """Project the stretch of a plane's line that its samples cover, and a little more."""
    a, b, c = line / np.hypot(line[0], line[1])
    direction, origin = np.array([-b, a]), np.array([-a * c, -b * c])
    along = on_plane @ direction
    margin = 0.02 * np.ptp(along)
    ends = origin + np.outer([along.min() - margin, along.max() + margin], direction)
    count = 2
    for _ in range(2):  # the first pass, of the two ends, only tells how long the curve is
        stretch = np.linspace(ends[0], ends[1], count)
        curve = project(camera, plane, np.column_stack([stretch, np.zeros(count)]))
        length = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
        count = 2 + int(min(MOST_CHORDS, length / CHORD_PX))
    return curve


def _compare(points: FloatArray, curve: FloatArray, plane: int) -> MeasuredSide:
    starts, chords = curve[:-1], np.diff(curve, axis=0)
    middles = starts + chords / 2
    nearest = np.argmin(((points[:, None] - middles[None]) ** 2).sum(axis=2), axis=1)
    directions = chords[nearest] / np.linalg.norm(chords[nearest], axis=1, keepdims=True)
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    residuals = ((points - starts[nearest]) * normals).sum(axis=1)
    return MeasuredSide(points, curve, residuals, normals, plane)
