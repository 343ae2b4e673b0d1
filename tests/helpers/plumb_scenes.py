"""Pictures of straight and of curved edges, seen through a known lens."""

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

SUPERSAMPLING = 2
MARGIN = 1.6
SHIFT = 4
BLUR = 1.2
FOCAL = 0.9
"""Focal length over the width."""


class PlumbScene(NamedTuple):
    """A picture, and the lens that distorted it."""

    picture: np.ndarray
    K: np.ndarray
    distortion: np.ndarray

    def ideal(self, points):
        """Return where a pinhole would see the scene's points that are at given pixels."""
        return undistorted(np.asarray(points), self.K, self.distortion)


def undistorted(points, K, distortion):
    """Undistort pixels, shape (N, 2), by a table of radii up to the fold."""
    k1, k2, _, _, k3 = distortion
    ideal = np.linspace(0, 1.5, 20_000)
    seen = ideal * (1 + k1 * ideal**2 + k2 * ideal**4 + k3 * ideal**6)
    fold = int(np.argmax(np.append(np.diff(seen) <= 0, True)))
    off = (points - K[:2, 2]) / K[0, 0]
    observed = np.hypot(off[..., 0], off[..., 1])
    radius = np.interp(observed, seen[: fold + 1], ideal[: fold + 1])
    return K[:2, 2] + K[0, 0] * off * (radius / np.maximum(observed, 1e-12))[..., None]


@cache
def ideal_pixels(size, focal, cx, cy, distortion):
    """Undistorted positions of the pixels of a picture drawn `SUPERSAMPLING` times as large."""
    K = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])
    x, y = ((np.arange(side * SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5 for side in size)
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    return undistorted(pixels, K, np.array(distortion)).astype(np.float32)


def quads(rng, canvas, count=24):
    """Fill quadrangles of any size and direction."""
    height, width = canvas.shape[:2]
    for _ in range(count):
        angle, sides = rng.uniform(0, np.pi), rng.uniform(0.08, 0.45, 2) * width
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        quad = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * sides / 2 @ turn.T
        quad = quad * rng.uniform(0.85, 1.15, (4, 1)) + rng.uniform(0, [width, height])
        fill(canvas, quad, rng)


def windows(rng, canvas):
    """Fill the windows of a house front in perspective, and circles before it."""
    height, width = canvas.shape[:2]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    front = ((unit - 0.5) * rng.uniform(0.95, 1.5, (4, 1)) * 1.1 + 0.5) * [width, height]
    seen = cv2.getPerspectiveTransform(unit.astype(np.float32), front.astype(np.float32))
    columns, rows = rng.integers(5, 10, 2)
    for column in range(columns):
        for row in range(rows):
            low = np.array([(column + 0.2) / columns, (row + 0.25) / rows])
            high = np.array([(column + 0.75) / columns, (row + 0.8) / rows])
            window = (low + unit * (high - low))[None]
            fill(canvas, cv2.perspectiveTransform(window, seen)[0], rng)
    for _ in range(6):
        circle(canvas, rng.uniform(0, [width, height]), rng.uniform(0.02, 0.2) * width, rng)


def small_windows(rng, canvas):
    """Fill many small squares in rows: only the rows are long."""
    height, width = canvas.shape[:2]
    pitch = 0.045 * width
    for x in np.arange(0.1 * width, 0.9 * width, pitch):
        for y in np.arange(0.1 * height, 0.9 * height, pitch):
            fill(canvas, np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 0.6 * pitch + [x, y], rng)


def room(rng, canvas):
    """Draw a wall of large windows above a wooden floor, with many wavy strands."""
    height, width = canvas.shape[:2]
    for x in np.arange(0.12, 0.9, 0.2) * width:
        for y in (0.15, 0.36):
            low = np.array([x, y * height])
            fill(canvas, low + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 0.13 * width, rng)
    floor = int(0.6 * height)
    noise = rng.normal(size=(height - floor, width)).astype(np.float32)
    strands = cv2.GaussianBlur(noise, (0, 0), 40 * SUPERSAMPLING, sigmaY=2.5 * SUPERSAMPLING)
    canvas[floor:] = np.clip(110 + 45 * strands / strands.std(), 0, 255)[..., None]


def arches(rng, canvas):
    """Draw arcs about a point below the picture, and nothing else."""
    height, width = canvas.shape[:2]
    for radius in np.arange(0.1, 2.5, 0.05) * width:
        circle(canvas, np.array([0.5 * width, 1.3 * height]), radius, rng)


def circles(rng, canvas):
    """Draw circles of all sizes, anywhere."""
    height, width = canvas.shape[:2]
    for _ in range(40):
        centre = rng.uniform([-width, -height], [2 * width, 2 * height])
        circle(canvas, centre, rng.uniform(0.05, 1.5) * width, rng)


def spokes(rng, canvas):
    """Draw lines through the picture's middle."""
    middle = 0.5 * (np.array(canvas.shape[1::-1]) - 1)
    for angle in np.arange(0, 2 * np.pi, 0.21):
        across = np.array([-np.sin(angle), np.cos(angle)])
        far = middle + 2 * middle[0] * np.array([np.cos(angle), np.sin(angle)])
        fill(canvas, np.array([middle, far, far + 0.02 * middle[0] * across]), rng)


def fill(canvas, polygon, rng):
    colour = tuple(int(value) for value in rng.integers(20, 110, 3))
    fixed = np.rint(np.asarray(polygon) * 2**SHIFT).astype(np.int32)
    cv2.fillPoly(canvas, [fixed], colour, cv2.LINE_AA, SHIFT)


def circle(canvas, centre, radius, rng):
    """Draw a ring; OpenCV's own circles are coarse polygons."""
    angles = np.linspace(0, 2 * np.pi, 5000)
    points = centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    fixed = np.rint(points * 2**SHIFT).astype(np.int32)
    colour = tuple(int(value) for value in rng.integers(20, 235, 3))
    cv2.polylines(canvas, [fixed], True, colour, 10, cv2.LINE_AA, SHIFT)


def plumb_scene(rng, size, k1, draw=windows, centre=None, noise=2.0, k2=0.0, k3=0.0):
    """Draw a plane scene, seen through a radial lens."""
    middle = (np.array(size) - 1) / 2
    focal = FOCAL * size[0]
    cx, cy = middle if centre is None else centre
    K = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])
    distortion = (k1, k2, 0.0, 0.0, k3)
    scale = SUPERSAMPLING
    canvas_size = np.rint(np.array(size) * scale * MARGIN).astype(int)
    canvas = np.full((canvas_size[1], canvas_size[0], 3), 150, np.uint8)
    draw(rng, canvas)
    ideal = ideal_pixels(size, focal, float(cx), float(cy), distortion)
    source = (ideal - np.float32(middle)) * scale + np.float32((canvas_size - 1) / 2)
    seen = cv2.remap(canvas, source[..., 0], source[..., 1], cv2.INTER_LINEAR)
    blurred = cv2.GaussianBlur(seen, (0, 0), BLUR)
    small = cv2.resize(blurred, size, interpolation=cv2.INTER_AREA)
    picture = np.clip(small + rng.normal(0, noise, small.shape), 0, 255).astype(np.uint8)
    return PlumbScene(picture, K, np.array(distortion))
