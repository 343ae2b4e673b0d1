"""Real boards: what a camera fitted to two thirds of the lines, or corners, says of the rest."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from real_pictures import DATA
from rows import Row

import trisquare as ts

Array = npt.NDArray[np.float64]

EVERY = 3  # of three lines, or diagonals of corners, one is held out
SEED = 12
TRIPLES = 10
FIELD = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST  # k1 and k2, as ours
HELD = ("aspect", "focal", "principal_point", "distortion")
GRADIENT_STEP = 0.01  # pixels


@dataclass(frozen=True)
class Corners:
    """Corners of one board in one picture, as another detector has them."""

    grid: Array  # (N, 2), in cells
    pixels: Array  # (N, 2)

    def of(self, held_out: bool) -> Corners:
        """Return the corners of every third diagonal, or all others."""
        chosen = (np.rint(self.grid).astype(int).sum(axis=1) % EVERY == EVERY - 1) == held_out
        return Corners(self.grid[chosen], self.pixels[chosen])

    @property
    def on_plane(self) -> Array:
        """The same on the board's plane, as OpenCV takes them."""
        return np.column_stack([self.grid, np.zeros(len(self.grid))]).astype(np.float32)


@dataclass(frozen=True)
class Case:
    """What is calibrated at once."""

    name: str
    boards: list[ts.PlaneEdges]
    corners: list[Corners]
    size: tuple[int, int]


@dataclass(frozen=True)
class Scores:
    """Root mean square distances, pixels: lines that were held out, and corners per coordinate."""

    lines: float
    corners: float


def measure() -> list[Row]:
    """Print ours and OpenCV's on their own held-out data, and each camera on the other's."""
    if not DATA.exists():
        return [Row("held-out error", "no ../shared/data", "ours <= OpenCV's", None)]
    worse, better, crossed, count = [], 0, 0, 0
    for case in cases():
        try:
            camera, own = _ours(case)
        except ts.TrisquareError as error:
            print(f"  {case.name}: {error}")
            worse.append(case.name)
            continue
        other, theirs = _opencv(case)
        print(
            f"  {case.name}: ours {own.lines:.3f} px on lines, {own.corners:.3f} px on corners;"
            f" OpenCV {theirs.corners:.3f} px on corners, {theirs.lines:.3f} px on lines"
            f" (fx {camera.fx:.0f}, {other.fx:.0f})"
        )
        count += 1
        better += own.lines < theirs.corners
        crossed += own.lines <= theirs.lines
        if own.lines > theirs.corners:
            worse.append(case.name)
    return [
        Row(
            f"held-out lines beside OpenCV's held-out corners, {count} real sets",
            f"ours smaller on {better}" + (f", larger on {', '.join(worse)}" if worse else ""),
            "no worse on any",
            not worse,
        ),
        Row(
            "the same lines, for our camera and for OpenCV's (poses fitted to each)",
            f"ours no worse on {crossed} of {count}",
            "",
            None,
        ),
    ]


def cases() -> Iterator[Case]:
    """Yield the pictures, or sets of one camera's, that can be calibrated."""
    for side in ("left", "right"):
        path = DATA / "ortho-corner" / f"{side}_calib.jpg"
        reference = json.loads((path.parent / f"reference_{side}_zhang3boards.json").read_text())
        boards = reference["boards"]
        corners = [_corners(board["grid_ij"], board["corners_xy"]) for board in boards]
        yield _case(f"ortho {side}", [_detected(path, "auto")], [corners])
    views: dict[str, list[Corners]] = {}
    cube = DATA / "charuco-cube"
    for view in json.loads((cube / "corners_cam0.json").read_text()):
        grid = np.array(view["obj_mm_xy"]) / 3.2
        views.setdefault(view["image"], []).append(_corners(grid, view["corners_xy"]))
    seen = {}
    for name in views:
        try:
            seen[name] = _detected(cube / name, "auto")
        except ts.TrisquareError as error:
            print(f"  cube {name}: {error}")
    for name in ("cam0/7.jpg", "cam0/8.jpg"):
        if name in seen:
            yield _case(f"cube {name}", [seen[name]], [views[name]])
    names = list(seen)
    yield _case("cube pooled", [seen[name] for name in names], [views[name] for name in names])
    chess = DATA / "opencv-chess"
    views_of_chess = json.loads((chess / "corners_left_cornerSubPix.json").read_text())
    found, given = [], []
    for view in views_of_chess:
        found.append(_detected(chess / view["image"], "chessboard:9x6"))
        grid = np.indices(view["inner_corners"]).T.reshape(-1, 2)
        given.append([_corners(grid, view["corners_xy"])])
    yield _case("chess pooled", found, given)
    rng = np.random.default_rng(SEED)
    for _ in range(TRIPLES):
        triple = sorted(rng.choice(len(found), 3, replace=False).tolist())
        yield _case(f"chess {triple}", [found[i] for i in triple], [given[i] for i in triple])


def _detected(path: Any, targets: str) -> tuple[list[ts.PlaneEdges], tuple[int, int]]:
    height, width = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).shape
    boards = [edges for edges in ts.detect(path, targets) if edges.kind == "chessboard"]
    return boards, (width, height)


def _corners(grid: npt.ArrayLike, pixels: npt.ArrayLike) -> Corners:
    return Corners(np.asarray(grid, dtype=np.float64), np.asarray(pixels, dtype=np.float64))


def _case(
    name: str,
    detected: Sequence[tuple[list[ts.PlaneEdges], tuple[int, int]]],
    corners: Iterable[list[Corners]],
) -> Case:
    boards: list[ts.PlaneEdges] = []
    for image, (found, _) in enumerate(detected):
        boards += [
            replace(edges, image=image, plane=len(boards) + i) for i, edges in enumerate(found)
        ]
    return Case(name, boards, [c for some in corners for c in some], detected[0][1])


def _lines(edges: ts.PlaneEdges, held_out: bool) -> ts.PlaneEdges:
    """Return the board with every third of its lines alone, or without them."""
    numbers = np.arange(len(edges.lines))
    chosen = np.flatnonzero((numbers % EVERY == EVERY // 2) == held_out)
    return replace(
        edges,
        lines=edges.lines[chosen],
        points=tuple(edges.points[i] for i in chosen),
        std=None if edges.std is None else tuple(edges.std[i] for i in chosen),
    )


def _ours(case: Case) -> tuple[ts.Camera, Scores]:
    result = ts.calibrate_edges([_lines(board, False) for board in case.boards], case.size)
    scores = Scores(_line_error(case, result), _corner_error(case, result.camera))
    return result.camera, scores


def _opencv(case: Case) -> tuple[ts.Camera, Scores]:
    kept = [corners.of(held_out=False) for corners in case.corners]
    _, K, distortion, turns, shifts = cv2.calibrateCamera(
        [corners.on_plane for corners in kept],
        [corners.pixels.astype(np.float32) for corners in kept],
        case.size,
        None,
        None,
        flags=FIELD,
    )
    camera = ts.Camera(K, distortion.ravel()[:5], case.size, "radial2")
    own = _distances(case, camera, zip(turns, shifts, strict=True))
    # The boards' poses are fitted to two thirds of the lines, with OpenCV's camera held.
    kept_lines = [_lines(board, False) for board in case.boards]
    held = ts.calibrate_edges(kept_lines, case.size, fix=HELD, initial=camera)
    return camera, Scores(_line_error(case, held), own)


def _line_error(case: Case, result: ts.Calibration) -> float:
    """Root mean square distance of held-out samples from the images of their lines."""
    distances = []
    for board, plane in zip(case.boards, result.planes, strict=True):
        rest = _lines(board, True)
        homography = np.column_stack([plane.rotation[:, :2], plane.translation])
        for line, points in zip(rest.lines, rest.points, strict=True):
            normal = np.linalg.solve(homography.T, line)
            distances.append(_distance(result.camera, normal, points))
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


def _corner_error(case: Case, camera: ts.Camera) -> float:
    """As OpenCV scores its own camera, poses fitted to two thirds of the corners."""
    poses = []
    for corners in case.corners:
        kept = corners.of(held_out=False)
        _, turn, shift = cv2.solvePnP(kept.on_plane, kept.pixels, camera.K, camera.distortion)
        poses.append((turn, shift))
    return _distances(case, camera, poses)


def _distances(case: Case, camera: ts.Camera, poses: Iterable[tuple[Any, Any]]) -> float:
    """Root mean square error per coordinate of held-out corners, pixels."""
    errors = []
    for corners, (turn, shift) in zip(case.corners, poses, strict=True):
        rest = corners.of(held_out=True)
        seen, _ = cv2.projectPoints(rest.on_plane, turn, shift, camera.K, camera.distortion)
        errors.append(seen.reshape(-1, 2) - rest.pixels)
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
