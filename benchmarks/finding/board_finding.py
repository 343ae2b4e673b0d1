"""Boards of all kinds in pictures with clutter: found, and false boards.

A board is found if one lattice has at least 90 % of its visible crossings, each within 2 px, and no
wrong ones; a single board, if it has all. A false board is a lattice that is on no board.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from harness.rows import Row
from real.calib_targets_finder import VERSION, find_with_calib_targets

from trisquare import simulate
from trisquare.detection.boards.find import find_lattices
from trisquare.detection.candidates import Lattice
from trisquare.simulate.clutter import cluttered_ground
from trisquare.simulate.scene import Scene
from trisquare_scenes.photo_like import FIGURES, KINDS, real_picture

SEED = 43
PICTURES = 54
"""Number of pictures of real scenes: the same number of each kind that has boards."""

BOARD_KINDS = tuple(kind for kind in KINDS if kind not in FIGURES or kind == "charuco box")

SINGLE = 24
"""Number of pictures of one board of known size, which OpenCV can also search for."""

CLUTTERED = 12
"""Number of pictures of each kind of clutter."""

NEAR = 2.0
"""Maximum distance, in pixels, of a crossing found from its true position."""

WHOLE = 0.9
"""Minimum fraction of a board's visible crossings in one lattice."""

FOUND_TARGET = 0.95
SPLIT_TARGET = 0.02
"""Maximum fraction of boards that are split."""

Picture = np.ndarray
Points = np.ndarray

FINDERS = {"trisquare": find_lattices}
if find_with_calib_targets is not None:
    FINDERS[f"calib-targets {VERSION}"] = find_with_calib_targets


@dataclass(frozen=True, slots=True)
class Boards:
    """Outcomes for the boards of one or more pictures.

    Attributes
    ----------
    boards, found, split : int
        Number of visible boards; of those with one lattice that has nearly all their crossings and
        no others; of those with more than one lattice.
    wrong, crossings, false : int
        Number of crossings of lattices that are not on the lattice's board; of all crossings
        found; of lattices that are on no board.
    """

    boards: int = 0
    found: int = 0
    split: int = 0
    wrong: int = 0
    crossings: int = 0
    false: int = 0

    def __add__(self, other: Boards) -> Boards:
        names = [field.name for field in fields(self)]
        return Boards(*(getattr(self, name) + getattr(other, name) for name in names))


def judge(scene: Scene, lattices: list[Lattice], in_sight: Callable[[Points], Points]) -> Boards:
    """Compare lattices with a scene's boards."""
    boards = [i for i, target in enumerate(scene.targets) if target.is_board]
    crossings = [scene.image_points(i, scene.targets[i].board_corners()) for i in boards]
    # Where boards touch, the crossings of the outermost grid lines are visible, too.
    grids = [scene.image_points(i, _all_grid_points(scene.targets[i])) for i in boards]
    owned: dict[int, list[tuple[Points, int]]] = defaultdict(list)
    total = Boards()
    for lattice in lattices:
        points = lattice.crossings[lattice.present]
        on = [_gaps(points, grid) < NEAR for grid in grids]
        owner = int(np.argmax([mask.sum() for mask in on]))
        wrong = int(np.count_nonzero(~on[owner]))
        if 2 * wrong > len(points):
            total += Boards(false=1)
            continue
        owned[owner].append((points, wrong))
        total += Boards(wrong=wrong, crossings=len(points))
    for number, truth in enumerate(crossings):
        seen = truth[in_sight(truth)]
        pieces = owned[number]
        found = any(
            wrong == 0 and np.mean(_gaps(seen, points) < NEAR) >= WHOLE for points, wrong in pieces
        )
        total += Boards(boards=1, found=int(found), split=int(len(pieces) > 1))
    return total


def _gaps(points: Points, others: Points) -> Points:
    return np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)


def _all_grid_points(target: simulate.Target) -> Points:
    columns, rows = target.inner_corners
    u, v = np.meshgrid(np.arange(columns + 2), np.arange(rows + 2))
    return np.stack([u - 0.5 * (columns + 1), v - 0.5 * (rows + 1)], axis=-1).reshape(-1, 2)


def measure() -> list[Row]:
    """Print the results for each kind of scene, and for each kind of clutter."""
    if find_with_calib_targets is None:
        print("  calib-targets is not installed: no comparison with it")
    return [*_real_scenes(), _single_boards(), _clutter()]


def _real_scenes() -> Iterator[Row]:
    by_kind: dict[tuple[str, str], Boards] = defaultdict(Boards)
    for index in range(PICTURES):
        kind = BOARD_KINDS[index % len(BOARD_KINDS)]
        case = real_picture(np.random.default_rng([SEED, index]), kind)
        for finder, find in FINDERS.items():
            by_kind[finder, kind] += judge(case.scene, find(_grey(case.picture)), case.in_sight)
    totals = {finder: Boards() for finder in FINDERS}
    for (finder, kind), done in sorted(by_kind.items()):
        print(f"  {finder}: {kind}: {done}")
        totals[finder] += done
    total = totals["trisquare"]
    others = "".join(
        f"; {finder}: {done.found}" for finder, done in totals.items() if done is not total
    )
    name = f"{PICTURES} pictures with clutter"
    yield Row(
        f"{name}: boards found",
        f"{total.found} of {total.boards} ({total.wrong} wrong crossings of {total.crossings}, "
        f"{total.false} false boards{others})",
        f">= {FOUND_TARGET:.0%}",
        total.found >= FOUND_TARGET * total.boards,
    )
    yield Row(
        f"{name}: boards found in several pieces",
        str(total.split),
        f"<= {SPLIT_TARGET:.0%}",
        total.split <= SPLIT_TARGET * total.boards,
    )


def _single_boards() -> Row:
    """Compare on pictures of one board of known size, which is passed to OpenCV's finder."""
    whole: dict[str, int] = defaultdict(int)
    gaps: dict[str, list[Points]] = defaultdict(list)
    times: dict[str, list[float]] = defaultdict(list)
    for seed in range(SINGLE):
        picture, truth, size = _single_board(np.random.default_rng([SEED, 1, seed]))

        def find_given_size(picture: Picture, size: tuple[int, int] = size) -> list[Points]:
            found, corners = cv2.findChessboardCornersSB(picture, size)
            return [corners.reshape(-1, 2)] if found else []

        finders: dict[str, Callable[[Picture], Any]] = {
            **FINDERS,
            "`cv2.findChessboardCornersSB`, size given": find_given_size,
        }
        for finder, find in finders.items():
            start = time.perf_counter()
            pieces = find(picture)
            times[finder].append(time.perf_counter() - start)
            found = [p.crossings[p.present] if isinstance(p, Lattice) else p for p in pieces]
            if len(found) == 1 and len(found[0]) == len(truth):
                nearest = _gaps(truth, found[0])
                whole[finder] += int(nearest.max() < NEAR)
                gaps[finder].append(nearest)
    for finder in times:
        error = np.median(np.concatenate(gaps[finder])) if gaps[finder] else np.nan
        print(
            f"  {finder}: {whole[finder]} of {SINGLE} single boards found and nothing else, "
            f"crossings off by {error:.3f} px (median), {1e3 * np.median(times[finder]):.1f} ms"
        )
    ours, *others = times
    return Row(
        f"{SINGLE} pictures of one board of 3 x 3 to 11 x 11 crossings: found, and nothing else",
        f"{whole[ours]} ({'; '.join(f'{finder}: {whole[finder]}' for finder in others)})",
        "not fewer",
        all(whole[ours] >= whole[finder] for finder in others),
    )


def _single_board(rng: np.random.Generator) -> tuple[Picture, Points, tuple[int, int]]:
    """Draw a picture of one board; return its crossings and their numbers of columns and rows."""
    rows, columns = sorted(rng.integers(3, 12, 2).tolist())
    size = (columns, rows)  # the longer side is horizontal, because the picture is wide
    scene = simulate.chessboard_scene(rng, simulate.random_camera(rng), inner_corners=size)
    picture = simulate.render(
        scene,
        rng,
        noise=rng.uniform(1.0, 6.0),
        blur=rng.uniform(0.5, 1.5),
        contrast=rng.uniform(60.0, 200.0),
        shading=rng.uniform(0.0, 0.4),
        clutter=int(rng.integers(20, 80)),
    )
    return picture, scene.image_points(0, scene.targets[0].board_corners()), size


def _clutter() -> Row:
    false: dict[str, int] = defaultdict(int)
    for name, draw in CLUTTER.items():
        for finder, find in FINDERS.items():
            found = []
            for seed in range(CLUTTERED):
                lattices = find(draw(np.random.default_rng([SEED, 2, seed])))
                found += [int(np.count_nonzero(lattice.present)) for lattice in lattices]
            print(f"  {finder}: {name}: {len(found)} false boards, of crossings {found}")
            false[finder] += len(found)
    ours, *others = FINDERS
    beside = "".join(f"; {finder}: {false[finder]}" for finder in others)
    return Row(
        f"{CLUTTERED * len(CLUTTER)} pictures of {', '.join(CLUTTER)}: false boards",
        f"{false[ours]}{beside}",
        "0",
        false[ours] == 0,
    )


def _grey(picture: Picture) -> Picture:
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


SIZE = (1280, 960)


def _ground(rng: np.random.Generator) -> Picture:
    return _as_photographed(cluttered_ground(SIZE, rng, int(rng.integers(40, 160))), rng)


def _grille(rng: np.random.Generator) -> Picture:
    """Draw bars in two directions: every gap between four crossings looks the same."""
    pitch = float(rng.uniform(10.0, 60.0))
    ys, xs = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(np.float64)
    share = rng.uniform(0.3, 0.7, 2)
    bars = ((xs / pitch) % 1.0 < share[0]) | ((ys / pitch) % 1.0 < share[1])
    return _as_photographed(_tilted(np.where(bars, 200, 40).astype(np.uint8), rng), rng)


def _keyboard(rng: np.random.Generator) -> Picture:
    """Draw keys in shifted rows, or in an unshifted block."""
    level, keys = rng.permutation([40, 190]).tolist()
    canvas = np.full(SIZE[::-1], level, np.uint8)
    pitch = int(rng.integers(24, 80))
    gap = max(2, int(pitch * rng.uniform(0.1, 0.35)))
    shifted = rng.random() < 0.6
    for row in range(SIZE[1] // pitch):
        shift = int(pitch * rng.choice([0.0, 0.25, 0.5, 0.75])) if shifted else 0
        for column in range(SIZE[0] // pitch):
            corner = (column * pitch + shift, row * pitch)
            end = (corner[0] + pitch - gap, corner[1] + pitch - gap)
            cv2.rectangle(canvas, corner, end, keys, -1)
            letter = chr(int(rng.integers(65, 91)))
            place = (corner[0] + pitch // 4, corner[1] + 3 * pitch // 5)
            cv2.putText(canvas, letter, place, cv2.FONT_HERSHEY_SIMPLEX, pitch / 70, level, 1)
    return _as_photographed(_tilted(canvas, rng), rng)


def _mosaic(rng: np.random.Generator) -> Picture:
    """Draw tiles of random shades, of two or of many."""
    tile = int(rng.integers(12, 70))
    shape = (SIZE[1] // tile + 1, SIZE[0] // tile + 1)
    two = rng.random() < 0.5
    tiles = rng.choice([40, 200], shape) if two else rng.integers(20, 230, shape)
    canvas = np.kron(tiles, np.ones((tile, tile))).astype(np.uint8)[: SIZE[1], : SIZE[0]]
    return _as_photographed(_tilted(canvas, rng), rng)


def _text(rng: np.random.Generator) -> Picture:
    canvas = np.full(SIZE[::-1], 220, np.uint8)
    scale = rng.uniform(0.4, 1.4)
    for row in range(int(SIZE[1] / (30 * scale))):
        letters = "".join(chr(int(c)) for c in rng.integers(33, 127, 120))
        place = (10, int(30 * scale * (row + 1)))
        cv2.putText(canvas, letters, place, cv2.FONT_HERSHEY_SIMPLEX, scale, 30, 2, cv2.LINE_AA)
    return _as_photographed(_tilted(canvas, rng), rng)


CLUTTER = {
    "clutter": _ground,
    "grilles": _grille,
    "keyboards": _keyboard,
    "mosaics": _mosaic,
    "text": _text,
}


def _tilted(canvas: Picture, rng: np.random.Generator) -> Picture:
    """Warp a flat picture as seen obliquely."""
    width, height = SIZE
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved = corners + rng.uniform(-0.2, 0.2, (4, 2)) * SIZE
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.uniform(0, 360)), 1.0)
    moved = (moved @ turn[:, :2].T + turn[:, 2]).astype(np.float32)
    warp = cv2.getPerspectiveTransform(corners, moved)
    return np.asarray(
        cv2.warpPerspective(canvas, warp, SIZE, flags=cv2.INTER_AREA, borderValue=120), np.uint8
    )


def _as_photographed(canvas: Picture, rng: np.random.Generator) -> Picture:
    blurred = cv2.GaussianBlur(canvas, (0, 0), float(rng.uniform(0.5, 1.5))).astype(np.float64)
    noisy = blurred + rng.uniform(1.0, 5.0) * rng.standard_normal(canvas.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


if __name__ == "__main__":
    for row in measure():
        print(row)
