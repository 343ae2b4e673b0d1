"""Lengths measured on planes: one photograph's own camera beside Zhang's from 13 chessboards.

The paper's own test of a calibration. Both cameras measure in the same photographs and pose the
plane from the same edges, so that only the cameras differ. In real pictures, the pose is fitted to
the left part of a chessboard only, and the lengths are on the rest of it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

import cv2
import numpy as np
from accuracy.against_zhang import BOARDS, TUTORIAL_WINDOW, photograph_boards, zhang_camera
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
    "trisquare": "the photographs' own camera",
    "Zhang": f"Zhang's, of {BOARDS} chessboards",
    "true camera": "the true camera, where only the pose errs",
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
    return _rows(f"simulated, {CAMERAS * PICTURES} photographs of three frames", found, in_stds, 1)


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
    name = f"real chessboards, posed from {POSED_COLUMNS} of 9 columns"
    found, in_stds = real_lengths()
    label = f"{name}, in 10 photographs (own: camera of the other 3)"
    return _rows(label, found, in_stds, None)


def real_lengths() -> tuple[dict[str, list[float]], list[float]]:
    """Measure along rows and columns of the real boards, with Zhang's camera and with our own.

    Returns
    -------
    found : dict of str to list of float
        Relative errors, by the names of the cameras.
    in_stds : list of float
        Errors of our own in their stated standard deviations.
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
            f"rms error of {len(found[name])} lengths, {label}: {CAMERA_NAMES[name]}",
            f"{100 * size:.2g} %",
            "",
            None,
        )
        for name, size in sizes.items()
    ]
    ratio = sizes["trisquare"] / sizes["Zhang"]
    held = float(np.mean(np.abs(in_stds) < 2))
    return [
        *rows,
        Row(
            "the first / the second",
            f"{ratio:.2f}",
            "" if target is None else f"<= {target} (aim)",
            None if target is None else ratio <= target,
        ),
        Row("the first within 2 of its standard deviations", f"{100 * held:.0f} %", "95 %", None),
    ]


if __name__ == "__main__":
    for row in measure():
        print(row)
