"""Pose of a board from its lines with a given camera: as a flat board, or as bent paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

import trisquare as ts

Array = npt.NDArray[np.float64]

ORDERS = tuple((i, order - i) for order in (2, 3, 4) for i in range(order + 1))
"""Orders of Legendre polynomials in both directions that describe the heights of a sheet. Lower
orders belong to its pose."""

STIFFNESS = np.array([((i + j) / 2.0) ** 4 for i, j in ORDERS])
"""Weights of the penalty on the heights. Curvature, which sheets resist, grows with the square of
the order."""

HEIGHT = 0.01
"""Prior standard deviation of the heights of paper, as a fraction of half its extent, for samples
of 1 pixel: some tens of samples share the errors of their line, of some tenths of a pixel."""

GRADIENT_STEP = 0.01
"""Step, in pixels, for the gradient of a ray."""

POSE_STEP = 1e-6
MAX_STEPS = 10
LAST_STEP = 1e-7
"""Pose step, in radians or cells, that ends the iteration: a millionth of a cell is some
thousandths of a pixel at most."""


class LineSamples(NamedTuple):
    """Samples of a board's lines as a camera sees them.

    Attributes
    ----------
    lines : ndarray of float64, shape (N, 3)
        The line of each sample.
    rays, along_x, along_y : ndarray of float64, shape (N, 3)
        The samples' rays and their derivatives in the picture.
    """

    lines: Array
    rays: Array
    along_x: Array
    along_y: Array

    @classmethod
    def of(cls, camera: ts.Camera, lines: Array, points: Sequence[Array]) -> LineSamples:
        """Take the samples of some lines of a board."""
        pixels = np.concatenate(points)
        x, y = (
            (camera.unproject(pixels + step) - camera.unproject(pixels - step))
            / (2.0 * GRADIENT_STEP)
            for step in np.eye(2) * GRADIENT_STEP
        )
        each = np.repeat(lines, [len(own) for own in points], axis=0)
        return cls(each, camera.unproject(pixels), x, y)

    def distances(self, pose: Array) -> Array:
        """Return the samples' distances from the images of their lines, in pixels."""
        planes, gradients = self._planes(pose)
        return np.asarray((planes * self.rays).sum(axis=1) / gradients)

    def displacements(self, pose: Array, middle: Array, radius: float) -> Array:
        """Return the change of the distances per unit of height, shape (N, terms)."""
        planes, gradients = self._planes(pose)
        rotation, shift = _rotation(pose), pose[3:]
        normal = rotation[:, 2]
        depths = (normal @ shift) / (self.rays @ normal)
        points = ((self.rays * depths[:, None] - shift) @ rotation)[:, :2]
        x, y = (np.polynomial.legendre.legvander(own, 4) for own in (points - middle).T / radius)
        heights = np.column_stack([x[:, i] * y[:, j] for i, j in ORDERS]) * radius
        # A point P + z n on the ray x = (P + z n) / s, with P on a line, has l . x = z (l . n) / s.
        return np.asarray(heights * ((planes @ normal) / depths / gradients)[:, None])

    def _planes(self, pose: Array) -> tuple[Array, Array]:
        """Return the planes through the camera and the lines, and the distances' gradients."""
        homography = np.column_stack([_rotation(pose)[:, :2], pose[3:]])
        planes = self.lines @ np.linalg.inv(homography)
        x, y = ((planes * own).sum(axis=1) for own in (self.along_x, self.along_y))
        return planes, np.hypot(x, y)


class BoardPose(NamedTuple):
    """Pose of a board, and its bend."""

    pose: Array  # rotation vector and translation
    heights: Array
    middle: Array
    radius: float

    def errors(self, samples: LineSamples) -> Array:
        """Return the samples' distances from their expected positions, in pixels."""
        distances = samples.distances(self.pose)
        if not self.heights.any():
            return distances
        bend = samples.displacements(self.pose, self.middle, self.radius)
        return distances - bend @ self.heights


def fit_pose(start: Array, samples: LineSamples, bent: bool) -> BoardPose:
    """Fit a board's pose, and its heights if `bent`, by least squares."""
    offsets = -samples.lines[:, 2]
    columns, rows = offsets[samples.lines[:, 0] != 0.0], offsets[samples.lines[:, 0] == 0.0]
    middle = 0.5 * np.array([columns.min() + columns.max(), rows.min() + rows.max()])
    radius = 0.5 * max(np.ptp(columns), np.ptp(rows))
    found = BoardPose(start, np.zeros(len(ORDERS)), middle, radius)
    for _ in range(MAX_STEPS):
        jacobian = _pose_jacobian(found.pose, samples)
        if bent:
            jacobian = np.column_stack(
                [jacobian, -samples.displacements(found.pose, middle, radius)]
            )
        information = jacobian.T @ jacobian
        gradient = jacobian.T @ found.errors(samples)
        if bent:
            information[6:, 6:] += np.diag(STIFFNESS / HEIGHT**2)
            gradient[6:] += STIFFNESS / HEIGHT**2 * found.heights
        step = np.linalg.solve(information, gradient)
        heights = found.heights - step[6:] if bent else found.heights
        found = found._replace(pose=found.pose - step[:6], heights=heights)
        if np.abs(step[:6]).max() < LAST_STEP:
            break
    return found


def _pose_jacobian(pose: Array, samples: LineSamples) -> Array:
    columns = [
        (samples.distances(pose + step) - samples.distances(pose - step)) / (2.0 * POSE_STEP)
        for step in np.eye(6) * POSE_STEP
    ]
    return np.column_stack(columns)


def _rotation(pose: Array) -> Array:
    return np.asarray(cv2.Rodrigues(pose[:3])[0])
