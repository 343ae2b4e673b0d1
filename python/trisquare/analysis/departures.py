"""Departures of a photographed sheet from a true, flat one, by a linear step from its calibration.

The calibration's residuals are fitted again with all of its estimated parameters and, in addition,
a bow of each plane and a stretch of the print along one axis of the paper. So close to the solution
one Gauss-Newton step suffices; its covariance shows what a photograph cannot distinguish.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import NORMAL_MEDIAN, FloatArray
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.camera.lens_models import COEFFICIENTS
from trisquare.printing.folding import FOLDS
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

MATRIX_PLACES = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2), "skew": (0, 1)}
"""Rows and columns of parameters in the camera matrix."""

STEP = 1e-5
"""Step of the central differences, relative to the focal length, and absolute for coefficients and
in units of the plane."""

ROUNDS = 6
"""Number of iterations of reweighting; the weights of outliers settle within three."""

HUBER = 1.345
"""Residual, in standard deviations, above which it weighs less; 95 % efficient (Huber 1964)."""

BLOCK = 8
"""Number of neighbouring samples whose residuals are summed to find their correlation."""

FREE_PRIOR_STD = 1.0
"""Prior standard deviation of bows (in sides), of the stretch, and of the tone curve (in its own
standard deviations): no prior knowledge."""

LINEAR_STEP_ERROR = 0.04
"""Error of one linear step, as a fraction of a bow or stretch
(benchmarks/accuracy/sheet_check.py)."""

MAX_COST_INCREASE = 9.0
"""Increase of chi square up to which a worse reading of the sheet is possible: 3 standard
deviations."""


class Estimate(NamedTuple):
    """A number and its standard deviation."""

    value: float
    std: float


@dataclass(frozen=True, slots=True)
class Departures:
    """Departures of planes from those of a true sheet.

    Attributes
    ----------
    angles : dict of (int, int) to Estimate
        Angle between each two planes, on the side of the camera, degrees.
    bows : tuple of Estimate
        Maximum height of each plane's arch over one side of its figure, as a fraction of the side.
    stretches : tuple of Estimate
        Relative excess length of the print along one axis of the paper over the other, for each
        reading (orientation of the figures on the paper) that explains the edges; the best first.
    """

    angles: dict[tuple[int, int], Estimate]
    bows: tuple[Estimate, ...]
    stretches: tuple[Estimate, ...]


class _Samples(NamedTuple):
    """The samples of one figure, and the derivatives of their positions."""

    face: int
    is_further: bool
    points: FloatArray
    distances: FloatArray
    weights: FloatArray
    by_position: FloatArray
    by_camera: FloatArray
    by_tone: FloatArray


class _Solution(NamedTuple):
    change: FloatArray
    covariance: FloatArray
    cost: float  # weighted sum of squares
    variance: float  # of a residual, relative to the stated one


def departures(
    calibration: Calibration, faces: Sequence[int], side: float, *, is_corner: bool
) -> Departures:
    """Estimate how far three planes depart from those of a true sheet.

    Parameters
    ----------
    calibration : Calibration
        Calibration with edges and without fixed parameters.
    faces : sequence of int
        Indices of the planes that carry the sheet's figures.
    side : float
        Side of a figure, in the planes' unit.
    is_corner : bool
        Whether they are the faces of the folded sheet; else each is printed upright, and may be
        turned by any multiple of a right angle.
    """
    planes = [calibration.planes[face] for face in faces]
    samples = list(_samples(calibration, faces))
    readings = _corner_readings(planes) if is_corner else _flat_readings(len(planes))
    solutions = [_solve(samples, planes, side, reading) for reading in readings]
    solutions.sort(key=lambda solution: solution.cost)
    best = solutions[0]
    # The noise is estimated from the residuals of the best reading.
    max_cost = best.cost + MAX_COST_INCREASE * best.variance
    possible = [solution for solution in solutions if solution.cost <= max_cost]
    camera_count = len(calibration.parameters)
    return Departures(
        {
            (faces[first], faces[second]): _angle(planes, first, second, camera_count, best)
            for first, second in combinations(range(len(planes)), 2)
        },
        tuple(_bow(face, len(planes), best) for face in range(len(planes))),
        tuple(
            _with_step_error(float(solution.change[-1]), float(solution.covariance[-1, -1]))
            for solution in possible
        ),
    )


def _samples(calibration: Calibration, faces: Sequence[int]) -> Iterator[_Samples]:
    """Yield the samples of the figures on the faces, with the derivatives of their distances.

    The distances are computed anew: where the calibration found a relief, its residuals do not
    include it.
    """
    camera = calibration.camera
    seen_planes: set[int] = set()
    for figure, residuals in zip(calibration.edges, calibration.residuals, strict=True):
        number = residuals.plane
        if number not in faces:
            continue
        plane, is_further = calibration.planes[number], number in seen_planes
        seen_planes.add(number)
        pixels, normals = np.concatenate(figure.points), np.concatenate(residuals.normals)
        lines = np.repeat(
            figure.lines, [len(points_of_line) for points_of_line in figure.points], axis=0
        )
        pose = plane.rotation, plane.translation
        points = _core.points_on_plane(camera_for_core(camera), pose, pixels)
        along = np.sum(lines[:, :2] * points, axis=1)
        # Only the size of a figure within another is unknown.
        size = -(along @ lines[:, 2]) / (lines[:, 2] @ lines[:, 2]) if is_further else 1.0
        feet = points - (along + size * lines[:, 2])[:, None] * lines[:, :2]
        seen = feet @ plane.rotation[:, :2].T + plane.translation
        distances = np.sum((pixels - _projected(camera, seen)) * normals, axis=1)
        by_position = [
            (_projected(camera, seen + shift) - _projected(camera, seen - shift)) / (2.0 * STEP)
            for shift in STEP * np.eye(3)
        ]
        by_camera = []
        for name in calibration.parameters:
            step = STEP if name in COEFFICIENTS[camera.model] else STEP * camera.fx
            upper, lower = (_moved(camera, name, sign * step) for sign in (1.0, -1.0))
            by_camera.append((_projected(upper, seen) - _projected(lower, seen)) / (2.0 * step))
        drift = np.zeros(pixels.shape) if figure.drift is None else np.concatenate(figure.drift)
        std = np.ones(len(pixels)) if figure.std is None else np.concatenate(figure.std)
        yield _Samples(
            faces.index(number),
            is_further,
            feet,
            distances,
            1.0 / std,
            np.einsum("jni,ni->nj", by_position, normals),
            np.einsum("jni,ni->nj", by_camera, normals),
            np.sum(drift * normals, axis=1),
        )


def _projected(camera: Camera, points: FloatArray) -> FloatArray:
    return _core.project_points(camera_for_core(camera), np.ascontiguousarray(points))


def _moved(camera: Camera, name: str, step: float) -> Camera:
    """Return a camera with one parameter changed."""
    matrix, distortion = np.array(camera.K), np.array(camera.distortion)
    if name in COEFFICIENTS[camera.model]:
        distortion[COEFFICIENTS[camera.model].index(name)] += step
    else:
        matrix[MATRIX_PLACES[name]] += step
    return Camera(matrix, distortion, camera.image_size, camera.model, camera.valid_radius)


def _solve(
    samples: Sequence[_Samples], planes: Sequence[Plane], side: float, reading: Sequence[int]
) -> _Solution:
    """Explain the distances by camera, poses, sizes, tone curve, bows and stretch, in this order.

    `reading` is 1 for a plane whose X axis is the stretched axis of the paper, -1 for its Y axis.
    """
    camera_count, count = samples[0].by_camera.shape[1], len(planes)
    sizes = sum(sample_set.is_further for sample_set in samples)
    tone = camera_count + 6 * count + sizes
    bows = tone + 1
    columns = bows + 3 * count + 1
    blocks, size = [], camera_count + 6 * count
    for sample_set in samples:
        rotation = planes[sample_set.face].rotation
        block = np.zeros((len(sample_set.points), columns))
        block[:, :camera_count] = sample_set.by_camera
        from_origin = sample_set.points @ rotation[:, :2].T
        pose = camera_count + 6 * sample_set.face
        block[:, pose : pose + 3] = np.cross(from_origin, sample_set.by_position)
        block[:, pose + 3 : pose + 6] = sample_set.by_position
        if sample_set.is_further:
            block[:, size] = np.sum(sample_set.by_position * from_origin, axis=1)
            size += 1
        block[:, tone] = sample_set.by_tone
        along_x, along_y, depth = (sample_set.by_position @ rotation).T
        x, y = sample_set.points.T
        u, v = x / (0.5 * side), y / (0.5 * side)
        heights = np.stack([1.0 - u * u, -2.0 * u * v, 1.0 - v * v], axis=1)
        bow = bows + 3 * sample_set.face
        block[:, bow : bow + 3] = side * depth[:, None] * heights
        # Half of the stretch along each axis, with opposite signs; the pose takes up the size.
        block[:, -1] = 0.5 * reading[sample_set.face] * (along_x * x - along_y * y)
        blocks.append(sample_set.weights[:, None] * block)
    jacobian = np.concatenate(blocks)
    distances = np.concatenate(
        [sample_set.weights * sample_set.distances for sample_set in samples]
    )
    prior_weights = np.zeros(columns)
    prior_weights[tone:] = 1.0 / FREE_PRIOR_STD
    scale = np.linalg.norm(jacobian, axis=0) + prior_weights
    jacobian, prior = jacobian / scale, np.diag((prior_weights / scale) ** 2)
    weights, change, sigma = np.ones(len(distances)), np.zeros(columns), 1.0
    for _ in range(ROUNDS):
        information = (jacobian.T * weights) @ jacobian + sigma**2 * prior
        change = np.linalg.solve(information, jacobian.T @ (weights * distances))
        residuals = np.abs(distances - jacobian @ change)
        sigma = float(np.median(residuals)) / NORMAL_MEDIAN
        weights = np.minimum(1.0, HUBER * sigma / np.maximum(residuals, HUBER * sigma))
    cost = float(np.sum(weights * residuals**2))
    variance = (
        cost
        / (len(distances) - columns)
        * _correlation_factor(weights * (distances - jacobian @ change))
    )
    covariance = variance * np.linalg.inv(information) / np.outer(scale, scale)
    return _Solution(change / scale, covariance, cost, variance)


def _correlation_factor(residuals: FloatArray) -> float:
    """Return the variance of sums of neighbouring residuals over that of independent ones."""
    blocks = residuals[: len(residuals) // BLOCK * BLOCK].reshape(-1, BLOCK)
    return max(1.0, float(np.mean(blocks.sum(axis=1) ** 2) / (BLOCK * np.mean(blocks**2))))


def _angle(
    planes: Sequence[Plane], first: int, second: int, cameras: int, solution: _Solution
) -> Estimate:
    """Return the angle between two planes, which face the camera, degrees."""
    first_normal, second_normal = (planes[face].rotation[:, 2] for face in (first, second))
    across = np.cross(first_normal, second_normal)
    sine = float(np.linalg.norm(across))
    # A rotation by w changes a normal n by w x n, and the cosine of two by w . (n x n').
    slope = np.zeros(len(solution.change))
    for face, sign in ((first, 1.0), (second, -1.0)):
        pose = cameras + 6 * face
        slope[pose : pose + 3] = sign * across / sine
    between = np.arctan2(sine, first_normal @ second_normal) - slope @ solution.change
    std = np.sqrt(slope @ solution.covariance @ slope)
    return Estimate(180.0 - float(np.degrees(between)), float(np.degrees(std)))


def _bow(face: int, count: int, solution: _Solution) -> Estimate:
    """Return the larger curvature of a plane's relief, as the height of its arch over a side."""
    start = len(solution.change) - 1 - 3 * (count - face)
    xx, xy, yy = solution.change[start : start + 3]
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    largest = int(np.argmax(np.abs(values)))
    x, y = vectors[:, largest]
    slope = np.array([x * x, 2.0 * x * y, y * y])
    bow_covariance = solution.covariance[start : start + 3, start : start + 3]
    return _with_step_error(float(values[largest]), float(slope @ bow_covariance @ slope))


def _with_step_error(value: float, variance: float) -> Estimate:
    """Return a size with a standard deviation that includes the error of the linear step."""
    return Estimate(abs(value), float(np.hypot(np.sqrt(variance), LINEAR_STEP_ERROR * value)))


def _corner_readings(planes: Sequence[Plane]) -> list[list[int]]:
    """Return, for each order of the faces, which axis of each plane is the paper's first one."""
    readings = []
    for order in permutations(range(len(planes))):
        # The normals of the folded faces are the axes z, x and y of the corner's frame.
        z, x, y = (planes[face].rotation[:, 2] for face in order)
        cam_from_corner = np.column_stack([x, y, z])
        if np.linalg.det(cam_from_corner) < 0.0:
            continue  # folded the other way, print outside
        reading = [0] * len(planes)
        for face, fold in zip(order, FOLDS, strict=True):
            across, down = np.abs(planes[face].rotation[:, :2].T @ cam_from_corner @ fold[:, 0])
            reading[face] = 1 if across > down else -1
        readings.append(reading)
    return readings


def _flat_readings(count: int) -> list[list[int]]:
    """Return the readings of figures that may each be turned by a right angle."""
    return [[1, *other_axes] for other_axes in product((1, -1), repeat=count - 1)]
