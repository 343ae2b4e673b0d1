"""Small squares in the middle of a picture and straight lines all over it, with known truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trisquare import simulate
from trisquare.simulate.cramer_rao import DIFFERENCE_STEP, changed
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera

SHRINK = 0.5
"""Factor of the squares' sizes and of their distances from the middle."""
LENGTH_RANGE = (0.3, 0.9)
"""Range of a line's length, over the width."""
SPACING = 8.0
"""Distance between samples, pixels."""
ARC_CHORDS = 400
MAX_DRAWS = 1000


class ImagedLine(NamedTuple):
    """A straight line of the scene and its image."""

    ideal: Array  # normalised coordinates, shape (N, 2)
    image: Array  # pixels, shape (N, 2)
    normal: Array  # unit normals in the image, shape (N, 2)


def central_scene(rng: np.random.Generator, camera: TrueCamera | None = None) -> Scene:
    """Draw three small squares in the middle of the picture, and a camera if none is given."""
    scene = simulate.random_scene(rng, camera=camera)
    camera = scene.camera
    middle = 0.5 * (np.array(camera.image_size) - 1)
    targets = []
    for target in scene.targets:
        centre = camera.project(target.translation[None])
        ray = camera.rays(middle + SHRINK * (centre - middle))[0]
        targets.append(Target(target.rotation, ray * target.translation[2] / SHRINK))
    return Scene(camera, tuple(targets))


def imaged_lines(camera: TrueCamera, rng: np.random.Generator, count: int) -> list[ImagedLine]:
    """Draw straight lines of any direction all over the picture."""
    size = np.array(camera.image_size)
    lines: list[ImagedLine] = []
    for _ in range(MAX_DRAWS):
        angle = rng.uniform(0.0, np.pi)
        half = 0.5 * size[0] * rng.uniform(*LENGTH_RANGE)
        middle = rng.uniform(0.0, size)
        along = half * np.array([np.cos(angle), np.sin(angle)])
        ends = np.stack([middle - along, middle + along])
        if (ends < 0).any() or (ends > size - 1).any():
            continue
        start, end = camera.undistort(ends)
        dense = start + np.linspace(0.0, 1.0, ARC_CHORDS)[:, None] * (end - start)
        steps = np.linalg.norm(np.diff(_seen(camera, dense), axis=0), axis=1)
        arc = np.append(0.0, np.cumsum(steps))
        places = np.interp(
            np.arange(0.5 * SPACING, arc[-1], SPACING), arc, np.linspace(0.0, 1.0, ARC_CHORDS)
        )
        ideal = start + places[:, None] * (end - start)
        ahead = _seen(camera, ideal + 1e-6 * (end - start)) - _seen(camera, ideal)
        tangent = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        lines.append(ImagedLine(ideal, _seen(camera, ideal), normal))
        if len(lines) == count:
            return lines
    raise ValueError("the picture has no room for such lines")


def line_samples(
    line: ImagedLine, rng: np.random.Generator, noise: float, sagitta: float = 0.0
) -> Array:
    """Return noisy samples of a line's image, bent like a cable by a sagitta in pixels."""
    place = np.linspace(-1.0, 1.0, len(line.image))
    across = rng.normal(0.0, noise, len(place)) + sagitta * (1.0 - place**2)
    return np.asarray(line.image + line.normal * across[:, None])


def line_information(
    camera: TrueCamera, lines: Sequence[ImagedLine], noise: float, free: Sequence[str]
) -> Array:
    """Return lines' information on a camera's free parameters, their own positions eliminated."""
    total = np.zeros((len(free), len(free)))
    step = DIFFERENCE_STEP
    target = Target(np.eye(3), np.array([0.0, 0.0, 1.0]))
    for line in lines:
        columns = []
        for name in free:
            ahead, behind = (changed(camera, target, name, sign * step)[0] for sign in (1, -1))
            slope = (_seen(ahead, line.ideal) - _seen(behind, line.ideal)) / (2 * step)
            columns.append(np.sum(slope * line.normal, axis=1))
        chord = line.ideal[-1] - line.ideal[0]
        across = step * np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
        shift = _seen(camera, line.ideal + across) - _seen(camera, line.ideal - across)
        shifted = np.sum(shift * line.normal, axis=1) / (2 * step)
        line_columns = np.stack([shifted, shifted * np.linspace(-1.0, 1.0, len(shifted))], axis=1)
        rows = np.stack(columns, axis=1)
        rows = rows - line_columns @ np.linalg.lstsq(line_columns, rows, rcond=None)[0]
        total += rows.T @ rows / noise**2
    return total


def _seen(camera: TrueCamera, ideal: Array) -> Array:
    return camera.project(np.column_stack([ideal, np.ones(len(ideal))]))
