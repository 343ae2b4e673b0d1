"""Boards in photographs: their lines as measured by trisquare, and corners of another detector."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from real.real_pictures import DATA

import trisquare as ts

Array = npt.NDArray[np.float64]

FOLDS = 3
SEED = 12
TRIPLES = 10
NEAR = 0.25  # maximum distance, in cells, of another detector's corner from its crossing
MIN_LINES = 2  # minimum per direction for a fit: four lines determine a plane's pose
MIN_CORNERS = 6  # minimum for a fit, required by OpenCV
DRAWS = 100  # of thirds; a board for which none suffices is left out
SQUARE_CORNERS = ("ortho left", "ortho right", "cube cam0/7.jpg", "cube cam0/8.jpg")
"""Photographs with three planes that meet at right angles."""


class Board(NamedTuple):
    """A board's lines, and the corners of another detector that lie on its crossings."""

    edges: ts.PlaneEdges
    grid: npt.NDArray[np.int_]  # (N, 2), column and row of each corner
    pixels: Array  # (N, 2)

    @property
    def is_row(self) -> npt.NDArray[np.bool_]:
        """Which lines are rows, as a mask."""
        return np.asarray(self.edges.lines[:, 0] == 0.0)

    @property
    def first(self) -> Array:
        """Position of the first column and of the first row."""
        offsets = -self.edges.lines[:, 2]
        return np.array([offsets[~self.is_row].min(), offsets[self.is_row].min()])

    @property
    def corners(self) -> Array:
        """The corners on the board, with a third coordinate of zero, as required by OpenCV."""
        return np.column_stack([self.grid + self.first, np.zeros(len(self.grid))])

    def thirds(self, rng: np.random.Generator) -> Thirds | None:
        """Draw a third of the rows and of the columns for every fold."""
        places = -self.edges.lines[:, 2] - np.where(self.is_row, self.first[1], self.first[0])
        numbers = np.rint(places).astype(int)
        for _ in range(DRAWS):
            columns, rows = (
                rng.permutation(1 + numbers[own].max()) % FOLDS
                for own in (~self.is_row, self.is_row)
            )
            directions = [rows if is_row else columns for is_row in self.is_row]
            drawn = Thirds(
                np.array([own[n] for own, n in zip(directions, numbers, strict=True)]),
                np.column_stack([columns[self.grid[:, 0]], rows[self.grid[:, 1]]]),
            )
            if all(self._is_enough(drawn, fold) for fold in range(FOLDS)):
                return drawn
        return None

    def _is_enough(self, thirds: Thirds, fold: int) -> bool:
        """Return whether the data without a fold suffices for a fit."""
        kept = self.is_row[thirds.lines != fold]
        enough = min(kept.sum(), (~kept).sum()) >= MIN_LINES
        return bool(enough and (~thirds.held_corners(fold)).sum() >= MIN_CORNERS)

    def with_lines(self, chosen: npt.NDArray[np.bool_]) -> ts.PlaneEdges:
        """Return the board with only some of its lines."""
        std = self.edges.std
        return replace(
            self.edges,
            lines=self.edges.lines[chosen],
            points=tuple(self.samples(chosen)),
            std=None if std is None else tuple(std[i] for i in np.flatnonzero(chosen)),
        )

    def samples(self, chosen: npt.NDArray[np.bool_]) -> list[Array]:
        """Return the samples of some of its lines."""
        return [self.edges.points[i] for i in np.flatnonzero(chosen)]


class Thirds(NamedTuple):
    """The fold in which each line is held out, and the folds of each corner's column and row."""

    lines: npt.NDArray[np.int_]
    corners: npt.NDArray[np.int_]  # (N, 2)

    def held_corners(self, fold: int) -> npt.NDArray[np.bool_]:
        """Return which corners lie on a held-out row or column."""
        return np.asarray((self.corners == fold).any(axis=1))


@dataclass(frozen=True)
class Case:
    """Data of one calibration."""

    name: str
    boards: list[Board]
    size: tuple[int, int]


def cases() -> Iterator[Case]:
    """Yield the pictures, or sets of pictures by one camera, that can be calibrated."""
    for side in ("left", "right"):
        path = DATA / "ortho-corner" / f"{side}_calib.jpg"
        reference = json.loads((path.parent / f"reference_{side}_zhang3boards.json").read_text())
        corners = [board["corners_xy"] for board in reference["boards"]]
        yield from _case(f"ortho {side}", [path], [corners])
    cube = DATA / "charuco-cube"
    views: dict[str, list[npt.ArrayLike]] = {}
    for view in json.loads((cube / "corners_cam0.json").read_text()):
        views.setdefault(view["image"], []).append(view["corners_xy"])
    for name in ("cam0/7.jpg", "cam0/8.jpg"):
        yield from _case(f"cube {name}", [cube / name], [views[name]])
    yield from _case("cube pooled", [cube / name for name in views], list(views.values()))
    chess = DATA / "opencv-chess"
    seen = json.loads((chess / "corners_left_cornerSubPix.json").read_text())
    paths, given = [chess / view["image"] for view in seen], [[v["corners_xy"]] for v in seen]
    yield from _case("chess pooled", paths, given)
    rng = np.random.default_rng(SEED)
    for _ in range(TRIPLES):
        triple = sorted(rng.choice(len(paths), 3, replace=False).tolist())
        name = f"chess {triple}"
        yield from _case(name, [paths[i] for i in triple], [given[i] for i in triple])


def _case(
    name: str, paths: Sequence[Path], corners: Sequence[Sequence[npt.ArrayLike]]
) -> Iterator[Case]:
    """Yield the boards of some pictures, with their corners, if they calibrate a camera."""
    edges: list[ts.PlaneEdges] = []
    height, width = cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE).shape
    for image, path in enumerate(paths):
        try:
            found = ts.detect(path)
        except ts.TrisquareError as error:
            print(f"  {name}, {path.name}: {error}")
            continue
        edges += [
            replace(board, image=image, plane=len(edges) + i)
            for i, board in enumerate(board for board in found if board.kind == "chessboard")
        ]
    try:
        result = ts.calibrate_edges(edges, (width, height))
    except ts.TrisquareError as error:
        print(f"  {name}: {error}")
        return
    boards = []
    for board, plane in zip(edges, result.planes, strict=True):
        pixels = np.concatenate([np.array(c, dtype=np.float64) for c in corners[board.image]])
        boards.append(_with_corners(board, _on_plane(result.camera, plane, pixels), pixels))
    rng = np.random.default_rng(SEED)
    usable = [board for board in boards if board.thirds(rng) is not None]
    yield Case(name, usable, (width, height))


def _on_plane(camera: ts.Camera, plane: ts.Plane, pixels: Array) -> Array:
    """Return the points of a plane seen at pixels."""
    seen = camera.unproject(pixels) @ plane.rotation
    camera_from_plane = plane.rotation.T @ plane.translation
    distances = camera_from_plane[2] / seen[:, 2]
    return np.asarray((seen * distances[:, None] - camera_from_plane)[:, :2])


def _with_corners(edges: ts.PlaneEdges, points: Array, pixels: Array) -> Board:
    """Keep the corners that lie on a board's crossings."""
    is_row = edges.lines[:, 0] == 0.0
    offsets = [-edges.lines[~is_row, 2], -edges.lines[is_row, 2]]
    places = points - [own.min() for own in offsets]
    grid = np.rint(places).astype(int)
    inside = (grid >= 0).all(axis=1) & (grid <= [np.ptp(own) for own in offsets]).all(axis=1)
    chosen = inside & (np.abs(places - grid) < NEAR).all(axis=1)
    return Board(edges, grid[chosen], pixels[chosen])
