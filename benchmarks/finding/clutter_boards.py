"""Textures that look like chessboards: false boards.

Every board found is false. Chequered floors are left out, because in a picture they are the same as
a chessboard.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from harness.rows import Row
from numpy.typing import NDArray

from trisquare.detection.kinds import TargetKinds
from trisquare.measurement.boards import Board
from trisquare.measurement.find import search

SEED = 83
EACH = 6
"""Number of pictures of each of ten textures."""

SIZE = (1280, 960)
MARGIN = 1.5
"""Size of a texture over that of the picture, so that its border is not visible."""

NOISE_RANGE = (1.0, 5.0)  # grey levels
BLUR_RANGE = (0.5, 2.0)  # pixels
TILT = 0.25
"""Maximum displacement of the picture's corners, as a fraction of its size."""

Picture = NDArray[np.uint8]
Drawing = Callable[[np.random.Generator, NDArray[np.float64], NDArray[np.float64]], Picture]


def measure() -> list[Row]:
    """Print the number of false boards for each texture."""
    pictures = false = 0
    for name in TEXTURES:
        sizes = []
        for index in range(EACH):
            picture = texture(name, np.random.default_rng([SEED, index]))
            found = search(picture, TargetKinds.parse("auto")).targets
            boards = [one for one in found if isinstance(one, Board)]
            sizes += [board.lattice.present.shape for board in boards]
            false += bool(boards)
            pictures += 1
        print(f"  {name}: {len(sizes)} false boards of {sizes}")
    return [
        Row(
            f"{pictures} pictures of {', '.join(TEXTURES)}: pictures with a false board",
            str(false),
            "0",
            false == 0,
        )
    ]


def texture(name: str, rng: np.random.Generator) -> Picture:
    """Draw one of `TEXTURES` as a camera sees it obliquely."""
    x, y = np.meshgrid(*(np.arange(MARGIN * side) for side in SIZE))
    canvas = TEXTURES[name](rng, x, y)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * SIZE
    turn = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), float(rng.uniform(0, 360)), 1.0)
    moved = corners + TILT * rng.uniform(-1.0, 1.0, (4, 2)) * SIZE
    moved = moved @ turn[:, :2].T + turn[:, 2]
    ends = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * canvas.shape[::-1]).astype(np.float32)
    warp = cv2.getPerspectiveTransform(ends, moved.astype(np.float32))
    seen = cv2.warpPerspective(
        cv2.GaussianBlur(canvas, (0, 0), 0.8), warp, SIZE, borderValue=float(rng.uniform(60, 200))
    )
    light = 1.0 + rng.uniform(-0.3, 0.3) * np.linspace(-1.0, 1.0, SIZE[0])
    blurred = cv2.GaussianBlur(seen, (0, 0), rng.uniform(*BLUR_RANGE)) * light
    noisy = blurred + rng.uniform(*NOISE_RANGE) * rng.standard_normal(blurred.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _bytes(levels: NDArray[np.float64]) -> Picture:
    return np.clip(levels, 0, 255).astype(np.uint8)


def _weave(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw bands that go over and under each other, darker toward their edges."""
    pitch, width = rng.uniform(20.0, 70.0), rng.uniform(0.75, 0.98)
    u, v = (x / pitch) % 1.0 - 0.5, (y / pitch) % 1.0 - 0.5
    over = (x // pitch + y // pitch) % 2 == 0
    first, second = rng.uniform(90.0, 220.0, 2)
    across = np.where(over, u, v)
    round_ = 1.0 - rng.uniform(0.3, 0.9) * (2.0 * np.abs(across) / width) ** 2
    levels = np.where(over, first, second) * round_
    hole = (np.abs(u) > 0.5 * width) & (np.abs(v) > 0.5 * width)
    under = np.abs(across) > 0.5 * width
    return _bytes(
        np.where(hole, 20.0, np.where(under, 0.6 * np.where(over, second, first), levels))
    )


def _tiles(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw tiles of nearly one shade, with joints."""
    pitch, joint = rng.uniform(25.0, 120.0), rng.uniform(0.03, 0.15)
    level, joints = rng.permutation([rng.uniform(120, 220), rng.uniform(20, 100)])
    shades = rng.uniform(-15.0, 15.0, (200, 200))
    tiles = level + shades[(y // pitch).astype(int), (x // pitch).astype(int)]
    is_joint = ((x / pitch) % 1.0 < joint) | ((y / pitch) % 1.0 < joint)
    return _bytes(np.where(is_joint, joints, tiles))


def _octagons(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw a floor of light octagons with small dark squares between them."""
    pitch, size = rng.uniform(30.0, 120.0), rng.uniform(0.1, 0.3)
    u, v = np.abs((x / pitch) % 1.0 - 0.5), np.abs((y / pitch) % 1.0 - 0.5)
    dark = u + v < size if rng.random() < 0.5 else np.maximum(u, v) < size
    joint = np.minimum(0.5 - u, 0.5 - v) < 0.015
    return _bytes(np.where(dark, 40.0, np.where(joint, 140.0, rng.uniform(180.0, 225.0))))


def _bricks(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    height, long = rng.uniform(15.0, 50.0), rng.uniform(1.5, 3.5)
    shift = 0.5 * (y // height % 2)
    u, v = (x / (long * height) + shift), y / height
    shades = rng.uniform(40.0, 150.0, (400, 400))
    levels = shades[v.astype(int) % 400, u.astype(int) % 400]
    joint = ((u % 1.0) * long < 0.15) | (v % 1.0 < 0.15)
    return _bytes(np.where(joint, rng.uniform(160.0, 220.0), levels))


def _windows(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw dark panes, some with a light sky in them, in a light front."""
    pitch = rng.uniform(40.0, 110.0, 2)
    share = rng.uniform(0.5, 0.92, 2)
    u, v = x / pitch[0], y / pitch[1]
    panes = np.where(rng.random((100, 100)) < 0.25, 170.0, rng.uniform(20.0, 70.0, (100, 100)))
    pane = (u % 1.0 < share[0]) & (v % 1.0 < share[1])
    cross = np.abs(u % 1.0 - 0.5 * share[0]) < 0.03 * (rng.random() < 0.5)
    levels = panes[v.astype(int) % 100, u.astype(int) % 100]
    return _bytes(np.where(pane & ~cross, levels, rng.uniform(150.0, 220.0)))


def _carton(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw a carton: bars, code blocks of random cells, and characters in rows and columns."""
    canvas = np.full(x.shape, 170, np.uint8)
    for _ in range(40):
        left, top = (int(rng.uniform(0, side)) for side in canvas.shape[::-1])
        cell, count = int(rng.integers(4, 14)), int(rng.integers(8, 30))
        kind = rng.integers(3)
        if kind == 0:
            block = rng.choice([30, 200], (count, count))
        elif kind == 1:
            block = np.tile(rng.choice([30, 200], (1, 3 * count)), (count, 1))
        else:
            block = np.where((np.indices((count, count)) % 3 == 0).all(axis=0), 30, 200)
        sign = np.kron(block, np.ones((cell, cell))).astype(np.uint8)
        part = canvas[top : top + sign.shape[0], left : left + sign.shape[1]]
        part[:] = sign[: part.shape[0], : part.shape[1]]
    return canvas


def _text(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    canvas = np.full(x.shape, 220, np.uint8)
    scale = rng.uniform(0.4, 1.4)
    for row in range(int(canvas.shape[0] / (26 * scale))):
        letters = "".join(chr(int(c)) for c in rng.integers(33, 127, 220))
        place = (10, int(26 * scale * (row + 1)))
        cv2.putText(canvas, letters, place, cv2.FONT_HERSHEY_DUPLEX, scale, 30, 1, cv2.LINE_AA)
    return canvas


def _keyboard(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    pitch, gap = rng.uniform(30.0, 90.0), rng.uniform(0.05, 0.3)
    shift = rng.choice([0.0, 0.25, 0.5], 200)[(y // pitch).astype(int)] * (rng.random() < 0.5)
    u, v = x / pitch + shift, y / pitch
    level, keys = rng.permutation([35.0, 190.0])
    key = (u % 1.0 > gap) & (v % 1.0 > gap)
    letters = rng.random((200, 3, 200, 3)) < 0.4
    sign = letters[
        v.astype(int) % 200,
        (v % 1.0 * 3).astype(int),
        u.astype(int) % 200,
        (u % 1.0 * 3).astype(int),
    ]
    sign &= (np.abs(u % 1.0 - 0.6) < 0.17) & (np.abs(v % 1.0 - 0.6) < 0.17)
    return _bytes(np.where(key & ~sign, keys, level))


def _cloth(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw gingham and tartan: stripes in two directions that darken each other."""
    pitch = rng.uniform(25.0, 90.0)
    share = rng.uniform(0.3, 0.7)
    first = np.where((x / pitch) % 1.0 < share, rng.uniform(0.4, 0.7), 1.0)
    second = np.where((y / pitch) % 1.0 < share, rng.uniform(0.4, 0.7), 1.0)
    fine = 1.0 - 0.3 * ((x + y) % 6.0 < 3.0)
    return _bytes(230.0 * first * second * fine)


def _crossword(rng: np.random.Generator, x: NDArray[np.float64], y: NDArray[np.float64]) -> Picture:
    """Draw cells that are light or dark at random, or in blocks of basket weave."""
    pitch = rng.uniform(18.0, 70.0)
    row, column = (y // pitch).astype(int), (x // pitch).astype(int)
    if rng.random() < 0.5:
        dark = (rng.random((300, 300)) < rng.uniform(0.15, 0.5))[row, column]
    else:
        dark = np.where((row // 2 + column // 2) % 2 == 0, row % 2, column % 2) == 0
    joint = ((x / pitch) % 1.0 < 0.04) | ((y / pitch) % 1.0 < 0.04)
    return _bytes(np.where(dark | joint, 30.0, 210.0))


TEXTURES: dict[str, Drawing] = {
    "woven bands": _weave,
    "tiles": _tiles,
    "octagons": _octagons,
    "bricks": _bricks,
    "windows": _windows,
    "cartons": _carton,
    "text": _text,
    "keyboards": _keyboard,
    "cloth": _cloth,
    "crosswords": _crossword,
}
