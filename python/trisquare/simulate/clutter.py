"""A cluttered ground for the targets' sheets, with which a search for squares must cope."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

Canvas = npt.NDArray[np.uint8]
Draw = Callable[[Canvas, np.random.Generator, int, int, int, int], None]

_WORDS = ("square", "KALIBER", "0 1 2 3", "f = 35 mm", "edge", "17 Mar", "#42", "OXO")


def cluttered_ground(image_size: tuple[int, int], rng: np.random.Generator, count: int) -> Canvas:
    """Draw `count` things on an uneven ground: coded grey levels, shape (H, W).

    They are circles, triangles and other polygons, lines, words, blobs and stripes.
    """
    width, height = image_size
    canvas = _uneven_ground(width, height, rng)
    things = (_circle, _polygon, _line, _word, _blob, _stripes, _polygon)
    for _ in range(count):
        draw = things[rng.integers(len(things))]
        size = int(rng.uniform(0.02, 0.12) * width)
        x, y = int(rng.uniform(0, width)), int(rng.uniform(0, height))
        draw(canvas, rng, x, y, size, int(rng.integers(0, 256)))
    return canvas


def _uneven_ground(width: int, height: int, rng: np.random.Generator) -> Canvas:
    """Return cloudy mid grey with speckle, like a table top or a floor."""
    coarse = rng.standard_normal((6, 8)).astype(np.float32)
    clouds = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    speckle = rng.standard_normal((height, width)).astype(np.float32)
    ground = rng.uniform(70.0, 150.0) + rng.uniform(2.0, 12.0) * clouds
    ground += rng.uniform(0.0, 8.0) * speckle
    canvas: Canvas = np.clip(ground, 0, 255).astype(np.uint8)
    return canvas


def _circle(
    canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int
) -> None:
    thickness = -1 if rng.random() < 0.5 else 3
    cv2.circle(canvas, (x, y), size // 2 + 1, level, thickness, cv2.LINE_AA)


def _polygon(
    canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int
) -> None:
    """Fill a triangle or a ragged polygon; three to seven corners, never a regular four."""
    corners = int(rng.choice([3, 3, 5, 6, 7]))
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    radii = size * rng.uniform(0.4, 1.0, corners)
    points = np.stack([x + radii * np.cos(angles), y + radii * np.sin(angles)], axis=1)
    cv2.fillPoly(canvas, [np.rint(points).astype(np.int32)], level, cv2.LINE_AA)


def _line(canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int) -> None:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    end = (int(x + 3 * size * np.cos(angle)), int(y + 3 * size * np.sin(angle)))
    cv2.line(canvas, (x, y), end, level, int(rng.integers(1, 6)), cv2.LINE_AA)


def _word(canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int) -> None:
    text = _WORDS[rng.integers(len(_WORDS))]
    scale = max(size / 50.0, 0.4)
    cv2.putText(canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, level, 2, cv2.LINE_AA)


def _blob(canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int) -> None:
    """Darken or lighten a soft patch, like a stain or a shadow."""
    height, width = canvas.shape
    rows = slice(max(y - 2 * size, 0), min(y + 2 * size, height))
    columns = slice(max(x - 2 * size, 0), min(x + 2 * size, width))
    dy, dx = np.mgrid[rows, columns]
    weight = 0.7 * np.exp(-((dx - x) ** 2 + (dy - y) ** 2) / (0.5 * size**2 + 1.0))
    under = canvas[rows, columns]
    canvas[rows, columns] = (under + weight * (level - under.astype(np.float64))).astype(np.uint8)


def _stripes(
    canvas: Canvas, rng: np.random.Generator, x: int, y: int, size: int, level: int
) -> None:
    """Draw a row of parallel bars, like a keyboard or a grating."""
    pitch = int(rng.integers(6, 14))
    for i in range(int(rng.integers(3, 9))):
        left = x + i * pitch
        cv2.rectangle(canvas, (left, y), (left + pitch // 2, y + size), level, -1)
