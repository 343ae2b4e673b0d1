"""Lenses of many coefficients, which no board near the corners of the picture determines."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from harness.rows import Row
from harness.truth import PINHOLE, Array

import trisquare as ts

SCENES = 60
SEED = 61
SIZE = (1280, 960)
CELLS = (6, 7)
BOARDS = 3
BOARD_WIDTH = 0.4  # of the picture's
SAMPLES = 60  # of each of a board's lines
NOISE = 0.05  # pixels
BEYOND_CORNER = 1.05  # the distance, in corners', up to which the lens's distortion grows
WRONG_STDS = 4.0


@dataclass(frozen=True)
class Lens:
    """A true lens: its camera matrix and its coefficients in OpenCV's order."""

    K: Array
    coefficients: Array

    def pixels(self, points: Array) -> Array:
        """Where points of camera coordinates are seen."""
        zero = np.zeros(3)
        return np.asarray(cv2.projectPoints(points, zero, zero, self.K, self.coefficients)[0][:, 0])

    def sees_all(self) -> bool:
        """Whether the distortion grows beyond the corner of the picture."""
        radii = np.linspace(0.0, 6.0, 601)
        points = np.column_stack([radii, np.zeros_like(radii), np.ones_like(radii)])
        seen = self.pixels(points)[:, 0] - self.K[0, 2]
        grows = int(np.argmax(np.diff(seen, append=-np.inf) <= 0.0))
        return bool(seen[grows] > BEYOND_CORNER * np.hypot(*SIZE) / 2.0)


def measure() -> list[Row]:
    """Count answers with a focal length or principal point beyond 4 stated standard deviations."""
    rows = []
    for model in ("rational", "brown"):
        deviations, left, silent, refused = [], [], 0, 0
        for number in range(SCENES):
            rng = np.random.default_rng([SEED, number])
            lens = _lens(rng, model)
            try:
                result = ts.calibrate_edges(_boards(rng, lens), SIZE, model=model)
            except ts.TrisquareError:
                refused += 1
                continue
            truth = (lens.K[0, 0], lens.K[1, 1], lens.K[0, 2], lens.K[1, 2])
            left.append(result.rms / NOISE)
            errors = np.array([getattr(result.camera, name) for name in PINHOLE]) - truth
            deviations.append(errors / [result.std[name] for name in PINHOLE])
            is_warned = any(warning.severity == "high" for warning in result.warnings)
            silent += bool(np.abs(deviations[-1]).max() > WRONG_STDS and not is_warned)
        rms = float(np.sqrt(np.mean(np.square(deviations))))
        wrong = int((np.abs(deviations).max(axis=1) > WRONG_STDS).sum())
        name = f"three boards from edges, {SCENES} lenses, model `{model}`"
        rows += [
            Row(f"{name}: refused", f"{refused}", "", None),
            Row(
                "the same: beyond 4 standard deviations; of these without a high warning",
                f"{wrong}; {silent}",
                "0; 0",
                wrong == 0,
            ),
            Row("the same: error / std, rms", f"{rms:.2f}", "<= 1.2", rms <= 1.2),
            Row(
                "the same: residuals / noise, largest rms of a lens",
                f"{max(left):.2f}",
                "<= 1.1",
                max(left) <= 1.1,
            ),
        ]
    return rows


def _lens(rng: np.random.Generator, model: str) -> Lens:
    """Draw a wide lens that sees all of the picture."""
    while True:
        fx = SIZE[0] * rng.uniform(0.42, 0.52)
        fy = fx * rng.uniform(0.998, 1.002)
        cx, cy = rng.normal([SIZE[0] / 2, SIZE[1] / 2], 0.01 * SIZE[0])
        p1, p2 = rng.normal(0.0, 0.0004, 2)
        if model == "rational":
            k4, k5, k6 = rng.uniform([0.4, 0.05, 0.0], [0.9, 0.2, 0.02])
            k1, k2, k3 = k4 + rng.uniform(-0.35, -0.25), rng.uniform(0.0, 0.1), 0.0
            coefficients = [k1, k2, p1, p2, k3, k4, k5, k6]
        else:
            k1, k2, k3 = rng.uniform([-0.3, 0.04, -0.03], [-0.15, 0.12, -0.003])
            coefficients = [k1, k2, p1, p2, k3]
        lens = Lens(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(coefficients))
        if lens.sees_all():
            return lens


def _boards(rng: np.random.Generator, lens: Lens) -> list[ts.PlaneEdges]:
    """Draw tilted boards inside the picture, and return noisy samples of their lines."""
    boards: list[ts.PlaneEdges] = []
    while len(boards) < BOARDS:
        turn = cv2.Rodrigues(rng.normal(0.0, 0.6, 3))[0]
        pixel = np.array([*rng.uniform(0.25, 0.75, 2) * SIZE, 1.0])
        direction = np.linalg.solve(lens.K, pixel)
        middle = direction * CELLS[0] * lens.K[0, 0] / (BOARD_WIDTH * SIZE[0])
        if abs(turn[:, 2] @ direction) < 0.5 * np.linalg.norm(direction):
            continue
        lines, samples = [], []
        for axis in (0, 1):
            for place in range(CELLS[axis] + 1):
                points = np.zeros((SAMPLES, 3))
                points[:, axis] = place - CELLS[axis] / 2
                points[:, 1 - axis] = np.linspace(-0.5, 0.5, SAMPLES) * CELLS[1 - axis]
                lines.append([1.0 - axis, float(axis), -float(place)])
                samples.append(lens.pixels(points @ turn.T + middle))
        seen = np.concatenate(samples)
        if (seen >= 0.0).all() and (seen <= np.array(SIZE) - 1.0).all():
            noisy = [own + rng.normal(0.0, NOISE, own.shape) for own in samples]
            boards.append(ts.PlaneEdges(np.array(lines), tuple(noisy), image=0, kind="chessboard"))
    return boards
