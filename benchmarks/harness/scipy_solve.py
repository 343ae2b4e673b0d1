"""The joint fit of `calibrate_edges`, written for SciPy."""

from __future__ import annotations

import numpy as np
from harness.truth import Array, camera_vector
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

import trisquare as ts

# Number of Newton steps on the distortion: convergence is quadratic, and six steps reach rounding
# inside the picture.
UNDISTORT_STEPS = 6
HUBER_LIMIT = 2.01  # standard deviations: 99 % efficient, as in trisquare
POSE_SIZE = 6  # rotation vector and translation


class ScipyProblem:
    """Residuals of all samples, vectorised: distance to their line's image, in pixels.

    The parameters are fx, fy, cx, cy, k1, k2 and a pose per square. Each sample is undistorted,
    and the algebraic distance of its ray to its line divided by the gradient in the photograph.
    """

    def __init__(self, figures: list[ts.PlaneEdges]) -> None:
        counts = [[len(points) for points in figure.points] for figure in figures]
        self.points = np.concatenate([np.concatenate(figure.points) for figure in figures])
        self.plane = np.repeat(np.arange(len(figures)), [sum(count) for count in counts])
        self.line = np.repeat(
            np.concatenate([figure.lines for figure in figures]), np.concatenate(counts), axis=0
        )

    @staticmethod
    def start(result: ts.Calibration) -> Array:
        """Return the parameters of a calibration, as a start."""
        poses = [
            np.append(Rotation.from_matrix(plane.rotation).as_rotvec(), plane.translation)
            for plane in result.planes
        ]
        return np.concatenate([camera_vector(result.camera.K, result.camera.distortion), *poses])

    def residuals(self, parameters: Array) -> Array:
        """Return the distances in pixels, shape (N,)."""
        fx, fy, cx, cy, k1, k2 = parameters[:6]
        poses = parameters[6:].reshape(-1, POSE_SIZE)
        rotations = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        homographies = np.concatenate([rotations[:, :, :2], poses[:, 3:, None]], axis=2)
        lines = np.einsum("nji,nj->ni", np.linalg.inv(homographies)[self.plane], self.line)
        observed = (self.points - [cx, cy]) / [fx, fy]
        x, y, (xx, xy, yy) = _undistort(observed, k1, k2)
        distance = lines[:, 0] * x + lines[:, 1] * y + lines[:, 2]
        determinant = xx * yy - xy * xy
        slope_x = (yy * lines[:, 0] - xy * lines[:, 1]) / (determinant * fx)
        slope_y = (xx * lines[:, 1] - xy * lines[:, 0]) / (determinant * fy)
        return distance / np.hypot(slope_x, slope_y)

    def solve(self, start: Array) -> OptimizeResult:
        """Minimise the squares of the residuals by Levenberg-Marquardt (MINPACK)."""
        return least_squares(self.residuals, start, method="lm", jac="2-point", x_scale="jac")

    def solve_robustly(self, start: Array, noise: float) -> OptimizeResult:
        """Minimise Huber's loss, as trisquare does before its final fit, with the noise given."""
        return least_squares(
            self.residuals,
            start,
            method="trf",  # the only method with a robust loss and without bounds
            jac="2-point",
            x_scale="jac",
            loss="huber",
            f_scale=HUBER_LIMIT * noise,
        )


def _undistort(observed: Array, k1: float, k2: float) -> tuple[Array, Array, tuple[Array, ...]]:
    """Return the ideal coordinates, and the derivative of the distortion there."""
    x, y = observed.T.copy()
    for _ in range(UNDISTORT_STEPS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * k2)
        bend = 2.0 * (k1 + 2.0 * k2 * r2)
        xx, xy, yy = radial + bend * x * x, bend * x * y, radial + bend * y * y
        error_x, error_y = observed[:, 0] - x * radial, observed[:, 1] - y * radial
        determinant = xx * yy - xy * xy
        x = x + (yy * error_x - xy * error_y) / determinant
        y = y + (xx * error_y - xy * error_x) / determinant
    return x, y, (xx, xy, yy)
