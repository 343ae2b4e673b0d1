"""Lengths measured on planes: trisquare's camera from one photograph and Zhang's from thirteen.

Both cameras measure the same lengths with poses from the same edges. Zhang's camera is from 13
pictures of a chessboard. In the pictures of three frames, trisquare's camera is that of the picture
itself. In the 10 photographs of a chessboard, trisquare's camera is from the three other
photographs and Zhang's from all; the pose is fitted to four of the nine columns, and the lengths
are on the rest of the board. With the true camera, only the pose has an error.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

import cv2
import numpy as np
from accuracy.against_zhang import TUTORIAL_WINDOW, photograph_boards, zhang_camera
from harness.rows import NotMeasurableError, Row
from harness.truth import Array, rms
from real.real_pictures import CHESS

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.plan import onto_plane
from trisquare.simulate.scene import Scene

CAMERAS = 6
PICTURES = 4
"""Number of pictures of three frames, per camera."""

SEGMENTS = 6
"""Number of segments on each plane."""

REACH = 1.5
"""Maximum distance of the ends of segments from the square's centre, in sides."""

SEED = 31
CORNER_STD = 0.1
"""Standard deviation, in pixels, of cornerSubPix on the real boards, from `chess_partitions`."""

TRIPLES = 6
POSED_COLUMNS = 4
"""Number of a board's nine columns to which the pose is fitted."""

CAMERA_NAMES = {
    "trisquare": "trisquare's camera",
    "Zhang": "Zhang's camera",
    "true camera": "the true camera",
}
"""Names of the cameras in the table."""

HELD = ("focal", "principal_point", "distortion")


def measure() -> list[Row]:
    """Print relative rms errors of lengths, and the coverage of two standard deviations."""
    if not CHESS.exists():
        raise NotMeasurableError("no ../shared/data")
    return [*_simulated(), *_real()]


def _simulated() -> list[Row]:
    found: dict[str, list[float]] = {"trisquare": [], "Zhang": [], "true camera": []}
    in_stds = []
    for number in range(CAMERAS):
        rng = np.random.default_rng([SEED, number])
        camera = simulate.random_camera(rng)
        photo = {"noise": rng.uniform(1, 4), "blur": rng.uniform(0.5, 1.2)}
        K, distortion = zhang_camera(camera, photograph_boards(camera, rng, photo), TUTORIAL_WINDOW)
        zhang = ts.Camera(K, distortion, camera.image_size, "brown")
        truth = ts.Camera(camera.K, camera.distortion, camera.image_size, "brown")
        for _ in range(PICTURES):
            scene = simulate.random_scene(rng, camera=camera, kind="frame")
            picture = simulate.render(scene, rng, tone="linear", **photo)
            result = ts.calibrate(picture, tone="linear")
            posed = {
                "Zhang": ts.locate(picture, zhang, tone="linear"),
                "true camera": ts.locate(picture, truth, tone="linear"),
            }
            for index, plane in enumerate(result.planes):
                for pixels, length in segments(scene, plane, truth, rng):
                    own = ts.measure(plane, pixels, result, point_std=0)
                    found["trisquare"].append(own.lengths[0] / length - 1)
                    in_stds.append((own.lengths[0] - length) / own.lengths_std[0])
                    for name, planes in posed.items():
                        other = zhang if name == "Zhang" else truth
                        seen = ts.measure(planes[index], pixels, other, point_std=0)
                        found[name].append(seen.lengths[0] / length - 1)
    return _rows(f"{CAMERAS * PICTURES} pictures of three frames", found, in_stds, 1)


def segments(
    scene: Scene, plane: ts.Plane, camera: ts.Camera, rng: np.random.Generator
) -> Iterable[tuple[Array, float]]:
    """Draw segments in the plane of a target: their pixels, and their lengths in sides."""
    distances = [
        np.linalg.norm(plane.corners.mean(axis=0) - scene.image_points(i, np.zeros((1, 2)))[0])
        for i in range(len(scene.targets))
    ]
    target = scene.targets[int(np.argmin(distances))]
    size = np.array(camera.image_size)
    drawn = 0
    while drawn < SEGMENTS:
        ends = rng.uniform(-REACH, REACH, (2, 2))
        points = ends @ target.rotation[:, :2].T + target.translation
        if not camera.can_project(points).all():
            continue
        pixels = camera.project(points)
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if length > 0.5 and np.all((pixels >= 0) & (pixels <= size - 1)):
            drawn += 1
            yield pixels, length


def _real() -> list[Row]:
    found, in_stds = real_lengths()
    return _rows("photographs of a chessboard", found, in_stds, None)


def real_lengths() -> tuple[dict[str, list[float]], list[float]]:
    """Measure along rows and columns of the real boards, with both cameras.

    Returns
    -------
    found : dict of str to list of float
        Relative errors, by the names of the cameras.
    in_stds : list of float
        Errors with trisquare's camera in their stated standard deviations.
    """
    views = json.loads((CHESS / "corners_left_cornerSubPix.json").read_text())
    pictures = [cv2.imread(str(CHESS / view["image"]), cv2.IMREAD_GRAYSCALE) for view in views]
    size = (pictures[0].shape[1], pictures[0].shape[0])
    corners = [np.array(view["corners_xy"], dtype=np.float64) for view in views]
    grid = np.indices(views[0]["inner_corners"]).T.reshape(-1, 2)
    board = np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)
    observed = [points.astype(np.float32) for points in corners]
    _, K, distortion, _, _ = cv2.calibrateCamera(
        [board] * len(views), observed, size, None, None, flags=cv2.CALIB_FIX_K3
    )
    zhang = ts.Camera(K, distortion.ravel(), size, "brown")
    edges = [ts.detect(picture, targets="chessboard:9x6") for picture in pictures]
    rng = np.random.default_rng(SEED)
    found: dict[str, list[float]] = {"trisquare": [], "Zhang": []}
    in_stds = []
    for _ in range(TRIPLES):
        triple = sorted(rng.choice(len(pictures), 3, replace=False))
        result = ts.calibrate([pictures[index] for index in triple], targets="chessboard:9x6")
        for index, (figure,) in enumerate(edges):
            if index in triple:
                continue
            lengths = {
                label: _board_lengths(figure, corners[index], camera, size)
                for label, camera in (("trisquare", result), ("Zhang", zhang))
            }
            for label, (measured, std, true) in lengths.items():
                found[label] += list(measured / true - 1)
                if label == "trisquare":
                    in_stds += list((measured - true) / std)
    return found, in_stds


def _board_lengths(
    figure: ts.PlaneEdges, corners: Array, camera: ts.Calibration | ts.Camera, size: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Measure along rows and columns of a board's far part: lengths, their stds, and the truth."""
    lens = camera.camera if isinstance(camera, ts.Calibration) else camera
    whole = ts.calibrate_edges([figure], size, model=lens.model, fix=HELD, initial=lens).planes[0]
    at = np.rint(onto_plane(corners, lens, whole) * 2) / 2  # each corner's position, to half a cell
    low = at[:, 0].min()
    posed = _left_of(figure, low + POSED_COLUMNS - 0.5, lens, whole)
    plane = ts.calibrate_edges([posed], size, model=lens.model, fix=HELD, initial=lens).planes[0]
    measured, stds, true = [], [], []
    for start, end in _far_pairs(at, low):
        found = ts.measure(plane, corners[[start, end]], camera, point_std=CORNER_STD)
        measured.append(found.lengths[0])
        stds.append(found.lengths_std[0])
        true.append(np.linalg.norm(at[end] - at[start]))
    return np.array(measured), np.array(stds), np.array(true)


def _far_pairs(at: Array, low: float) -> Iterable[tuple[int, int]]:
    """Pair the ends of each row and column of the part to which the pose is not fitted."""
    far = np.flatnonzero(at[:, 0] > low + POSED_COLUMNS - 0.5)
    for axis in (0, 1):
        for value in np.unique(at[far, axis]):
            line = far[at[far, axis] == value]
            along = at[line, 1 - axis]
            yield int(line[np.argmin(along)]), int(line[np.argmax(along)])


def _left_of(
    figure: ts.PlaneEdges, limit: float, lens: ts.Camera, plane: ts.Plane
) -> ts.PlaneEdges:
    """Keep the samples on one side of a column."""
    kept = [onto_plane(points, lens, plane)[:, 0] < limit for points in figure.points]
    chosen = [i for i, inside in enumerate(kept) if inside.sum() > 3]
    std = None if figure.std is None else [figure.std[i][kept[i]] for i in chosen]
    points = [figure.points[i][kept[i]] for i in chosen]
    return ts.PlaneEdges(figure.lines[chosen], points, std, kind=figure.kind)


def _rows(
    label: str, found: dict[str, list[float]], in_stds: list[float], target: float | None
) -> list[Row]:
    sizes = {name: rms(np.array(values)) for name, values in found.items()}
    rows = [
        Row(
            f"{label}, {len(found[name])} lengths: rms error with {CAMERA_NAMES[name]}",
            f"{100 * size:.2g} %",
            "",
            None,
        )
        for name, size in sizes.items()
    ]
    ratio = sizes["trisquare"] / sizes["Zhang"]
    within = float(np.mean(np.abs(in_stds) < 2))
    scenes = f"{label}, {len(in_stds)} lengths"
    return [
        *rows,
        Row(
            f"{scenes}: rms error with trisquare's camera / with Zhang's camera",
            f"{ratio:.2f}",
            "" if target is None else f"<= {target}",
            None if target is None else ratio <= target,
        ),
        Row(
            f"{scenes}: errors within 2 std, trisquare's camera",
            f"{100 * within:.0f} %",
            "95 %",
            None,
        ),
    ]


if __name__ == "__main__":
    for row in measure():
        print(row)
