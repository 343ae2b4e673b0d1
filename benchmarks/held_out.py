"""Real boards: what a camera fitted to two thirds of the rows and columns says of the rest.

Ours is fitted to lines and OpenCV's to another detector's corners, of the same rows and columns:
corners on a row or column that is held out are no part of OpenCV's. Both cameras are then asked for
the same points that neither saw: held-out corners, after poses from the other corners, and samples
of held-out lines, after poses from the other lines.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from real_pictures import DATA
from rows import Row

import trisquare as ts

Array = npt.NDArray[np.float64]

FOLDS = 3
SEED = 12
TRIPLES = 10
FIELD = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST  # k1 and k2, as ours
HELD = ("aspect", "focal", "principal_point", "distortion")
GRADIENT_STEP = 0.01  # pixels
NEAR = 0.25  # cells from a crossing within which another detector's corner is the same
LEAST_LINES = 2  # of a direction, to learn from: four lines place a plane
LEAST_CORNERS = 6  # to learn from: OpenCV asks for as many
NOISE = 2.0  # standard deviations of the mean over the folds that are no difference


class Board(NamedTuple):
    """A board's lines, and the corners of another detector that lie on its crossings."""

    edges: ts.PlaneEdges
    grid: npt.NDArray[np.int_]  # (N, 2), column and row of each corner
    pixels: Array  # (N, 2)

    def numbers(self) -> npt.NDArray[np.int_]:
        """Return the number of each line among those of its direction."""
        is_row = self.edges.lines[:, 0] == 0.0
        offsets = -self.edges.lines[:, 2]
        first = np.where(is_row, offsets[is_row].min(), offsets[~is_row].min())
        return np.rint(offsets - first).astype(int)

    def held_out(self, fold: int) -> Iterator[tuple[Array, Array]]:
        """Yield a fold's lines, with their samples."""
        for i in np.flatnonzero(self.numbers() % FOLDS == fold):
            yield self.edges.lines[i], self.edges.points[i]

    def without(self, fold: int) -> ts.PlaneEdges:
        """Return the board without a fold of its lines."""
        chosen = np.flatnonzero(self.numbers() % FOLDS != fold)
        return replace(
            self.edges,
            lines=self.edges.lines[chosen],
            points=tuple(self.edges.points[i] for i in chosen),
            std=None if self.edges.std is None else tuple(self.edges.std[i] for i in chosen),
        )

    def corners(self, fold: int, held_out: bool) -> tuple[npt.NDArray[np.float32], Array]:
        """Return corners on the board, and pixels, of a fold's rows and columns or of no such."""
        chosen = (self.grid % FOLDS == fold).any(axis=1) == held_out
        on_board = np.column_stack([self.grid, np.zeros(len(self.grid))])
        return on_board[chosen].astype(np.float32), self.pixels[chosen]

    def teaches(self, fold: int) -> bool:
        """Whether both have enough of the board without a fold."""
        kept = self.edges.lines[self.numbers() % FOLDS != fold]
        rows = int((kept[:, 0] == 0.0).sum())
        enough = min(rows, len(kept) - rows) >= LEAST_LINES
        return enough and len(self.corners(fold, held_out=False)[0]) >= LEAST_CORNERS


@dataclass(frozen=True)
class Case:
    """What is calibrated at once."""

    name: str
    boards: list[Board]
    size: tuple[int, int]


class Score(NamedTuple):
    """Root mean square errors of what was held out, pixels: of corners per coordinate."""

    lines: float
    corners: float


def measure() -> list[Row]:
    """Print both cameras' errors by set, and on how many sets ours are no larger."""
    if not DATA.exists():
        return [Row("held-out error", "no ../shared/data", "ours <= OpenCV's", None)]
    ratios: dict[str, Array] = {}
    for case in cases():
        try:
            scores = np.array([_scores(case, fold) for fold in range(FOLDS)])
        except ts.TrisquareError as error:
            print(f"  {case.name}: {error}")
            continue
        ours, theirs = scores.mean(axis=0)
        ratios[case.name] = np.log(scores[:, 0] / scores[:, 1])
        print(
            f"  {case.name}, {len(case.boards)} boards: lines {ours[0]:.3f} px, OpenCV"
            f" {theirs[0]:.3f}; corners {ours[1]:.3f} px, OpenCV {theirs[1]:.3f}"
        )
    both = {name: found.mean(axis=1, keepdims=True) for name, found in ratios.items()}
    rows = [_row("lines and corners", both, 0)]
    return [*rows, _row("lines", ratios, 0), _row("corners", ratios, 1)]


def _row(what: str, ratios: dict[str, Array], column: int) -> Row:
    """Compare the mean of the folds with its own noise."""
    smaller, larger = 0, []
    for name, found in ratios.items():
        mean = found[:, column].mean()
        noise = found[:, column].std(ddof=1) / np.sqrt(FOLDS)
        smaller += mean < 0.0
        if mean > NOISE * noise:
            larger.append(f"{name} ({np.expm1(mean):+.1%})")
    measured = f"smaller on {smaller} of {len(ratios)}"
    good = not larger and 2 * smaller > len(ratios)
    return Row(
        f"held-out {what}: our camera's error beside OpenCV's, {len(ratios)} real sets",
        measured + (f", clearly larger on {', '.join(larger)}" if larger else ""),
        "no worse on any, better on most" if what == "lines and corners" else "",
        good if what == "lines and corners" else None,
    )


def cases() -> Iterator[Case]:
    """Yield the pictures, or sets of one camera's, that can be calibrated."""
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
    usable = [board for board in boards if all(board.teaches(fold) for fold in range(FOLDS))]
    yield Case(name, usable, (width, height))


def _on_plane(camera: ts.Camera, plane: ts.Plane, pixels: Array) -> Array:
    """Points of a plane at which pixels look."""
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


def _scores(case: Case, fold: int) -> tuple[Score, Score]:
    """Fit both cameras without a fold, and ask them for it."""
    kept = [board.without(fold) for board in case.boards]
    ours = ts.calibrate_edges(kept, case.size).camera
    corners = [board.corners(fold, held_out=False) for board in case.boards]
    _, K, distortion, _, _ = cv2.calibrateCamera(
        [on_board for on_board, _ in corners],
        [pixels.astype(np.float32) for _, pixels in corners],
        case.size,
        None,
        None,
        flags=FIELD,
    )
    theirs = ts.Camera(K, distortion.ravel()[:5], case.size, "radial2")
    both = [
        Score(_line_error(case, camera, fold), _corner_error(case, camera, fold))
        for camera in (ours, theirs)
    ]
    return both[0], both[1]


def _line_error(case: Case, camera: ts.Camera, fold: int) -> float:
    """Distance of held-out samples from the images of their lines."""
    kept = [board.without(fold) for board in case.boards]
    result = ts.calibrate_edges(kept, case.size, fix=HELD, initial=camera)
    distances = []
    for board, plane in zip(case.boards, result.planes, strict=True):
        homography = np.column_stack([plane.rotation[:, :2], plane.translation])
        for line, points in board.held_out(fold):
            normal = np.linalg.solve(homography.T, line)
            distances.append(_distance(camera, normal, points))
    return float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))


def _distance(camera: ts.Camera, normal: Array, points: Array) -> Array:
    """Distance in the picture of points from the image of a plane through the camera's centre."""

    def height(pixels: Array) -> Array:
        return camera.unproject(pixels) @ normal

    x, y = np.eye(2) * GRADIENT_STEP
    gradient = [
        (height(points + step) - height(points - step)) / (2.0 * GRADIENT_STEP) for step in (x, y)
    ]
    return height(points) / np.hypot(*gradient)


def _corner_error(case: Case, camera: ts.Camera, fold: int) -> float:
    """Error per coordinate of held-out corners."""
    errors = []
    for board in case.boards:
        on_board, pixels = board.corners(fold, held_out=False)
        _, turn, shift = cv2.solvePnP(on_board, pixels, camera.K, camera.distortion)
        on_board, pixels = board.corners(fold, held_out=True)
        seen, _ = cv2.projectPoints(on_board, turn, shift, camera.K, camera.distortion)
        errors.append(seen.reshape(-1, 2) - pixels)
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
