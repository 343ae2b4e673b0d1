"""Chessboards are found without options, and nothing else is taken for one."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.detection.boards.find import chessboards_among, find_lattices

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="there is no ../shared/data")


def worst_gap(points, others):
    """Largest distance of a point to the nearest of the others, pixels."""
    return float(np.linalg.norm(points[:, None] - others, axis=2).min(axis=1).max())


def test_of_boards_of_a_stated_size_all_are_found_also_in_part():
    target = simulate.Target(
        np.eye(3), np.array([-5.5, -1.0, 30.0]), "chessboard", inner_corners=(7, 5)
    )
    others = [np.array([5.8, -1.0, 30.0]), np.array([0.0, 9.0, 36.0])]
    sizes = [(7, 5), (4, 4)]
    targets = [
        simulate.Target(np.eye(3), place, "chessboard", inner_corners=size)
        for place, size in zip(others, sizes, strict=True)
    ]
    camera = simulate.TrueCamera(1100.0, 1100.0, 640.0, 480.0)
    scene = simulate.Scene(camera, (target, *targets))
    picture = simulate.render(scene, np.random.default_rng(3), noise=2.0)
    found = find_lattices(picture)
    boards = chessboards_among(found, 7, 5)
    assert [board.present.shape for board in boards] == [(5, 7)] * 2
    assert [board.present.shape for board in chessboards_among(found, 5, 7)] == [(7, 5)] * 2
    # Less than half of a board of 9 x 9 is visible.
    assert [len(chessboards_among(found, *size)) for size in ((9, 6), (9, 9), (4, 4))] == [2, 0, 1]


def test_where_no_board_has_the_stated_size_the_error_says_what_size_there_is():
    board = simulate.Target(
        np.eye(3), np.array([0.0, 0.0, 20.0]), "chessboard", inner_corners=(8, 6)
    )
    camera = simulate.TrueCamera(600.0, 600.0, 320.0, 240.0, image_size=(640, 480))
    picture = simulate.render(simulate.Scene(camera, (board,)), np.random.default_rng(3))
    with pytest.raises(ts.DetectionError, match="8 x 6 of its inner corners are seen") as caught:
        ts.calibrate(picture, targets="chessboard:7x5")
    assert [one.kind for one in caught.value.rejected] == ["chessboard"]


@pytest.mark.parametrize(
    "inner_corners", [(3, 3), (9, 6), pytest.param((17, 12), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_rendered_boards_are_found_whole(inner_corners, seed):
    rng = np.random.default_rng([80, seed])
    camera = simulate.random_camera(rng)
    scene = simulate.chessboard_scene(rng, camera, inner_corners=inner_corners)
    picture = simulate.render(scene, rng, noise=6.0, contrast=60.0, shading=0.4)
    (lattice,) = find_lattices(picture)
    assert sorted(lattice.present.shape) == sorted(inner_corners)
    assert lattice.present.all()
    truth = scene.image_points(0, scene.targets[0].board_corners())
    assert worst_gap(truth, lattice.crossings.reshape(-1, 2)) < 1.0
    along = lattice.crossings[0, -1] - lattice.crossings[0, 0]
    down = lattice.crossings[-1, 0] - lattice.crossings[0, 0]
    assert along[0] * down[1] - along[1] * down[0] > 0.0


def flat_board(along, down, cells, blur, rng):
    """A noisy board without perspective with given sides of its cells, on light ground."""
    ys, xs = np.mgrid[0:960, 0:1280].astype(np.float64)
    sides = np.linalg.inv(np.column_stack([along, down]))
    u, v = np.tensordot(sides, np.stack([xs - 640.0, ys - 480.0]), axes=1)
    columns, rows = cells
    on = (np.abs(u) < columns / 2) & (np.abs(v) < rows / 2)
    dark = (np.floor(u + columns / 2) + np.floor(v + rows / 2)) % 2 == 0
    picture = np.where(on & dark, 60.0, 180.0)
    return photographed(picture, blur, rng)


def photographed(picture, blur, rng):
    blurred = cv2.GaussianBlur(picture, (0, 0), blur) + 2.0 * rng.standard_normal(picture.shape)
    return np.clip(np.rint(blurred), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("along", "down"),
    [((22.0, 2.0), (19.0, 14.0)), ((13.0, 1.0), (-11.0, 9.0)), ((9.5, 0.0), (0.0, 24.0))],
)
def test_small_slanted_cells_are_linked(along, down):
    rng = np.random.default_rng(83)
    (lattice,) = find_lattices(flat_board(along, down, (11, 8), 1.0, rng))
    assert sorted(lattice.present.shape) == [7, 10]
    assert lattice.present.all()


@pytest.mark.parametrize("blur", [0.7, 2.0])
def test_tiles_apart_from_each_other_are_no_board(blur):
    """When blurred, they look like a chessboard turned by 45 degrees."""
    ys, xs = np.mgrid[0:480, 0:640]
    for pitch, tile in ((14, 7), (18, 9), (30, 20), (40, 18)):
        inside = (xs % pitch < tile) & (ys % pitch < tile)
        for tiles, gaps in ((40.0, 200.0), (200.0, 40.0)):
            picture = np.where(inside, tiles, gaps)
            seen = photographed(picture, blur, np.random.default_rng(84))
            assert find_lattices(seen) == []


def test_noise_along_stripes_is_no_board():
    rng = np.random.default_rng(85)
    for pitch in (8, 9, 10):
        stripes = np.where(np.arange(480) % pitch < pitch / 2, 40.0, 200.0)
        assert find_lattices(photographed(np.tile(stripes, (360, 1)), 0.6, rng)) == []


@pytest.mark.parametrize("shape", [(1, 1), (1, 500), (40, 40), (300, 200)])
def test_pictures_without_boards(shape):
    noise = np.random.default_rng(81).integers(0, 256, shape, dtype=np.uint8)
    for picture in (noise, np.zeros_like(noise), np.full_like(noise, 255)):
        assert find_lattices(picture) == []


@needs_data
def test_boards_of_real_photographs():
    records = json.loads((DATA / "opencv-chess" / "corners_left_cornerSubPix.json").read_text())
    for record in records:
        grey = cv2.imread(str(DATA / "opencv-chess" / record["image"]), cv2.IMREAD_GRAYSCALE)
        lattice = find_lattices(grey)[0]
        assert np.count_nonzero(lattice.present) == 54
        corners = np.array(record["corners_xy"])
        assert worst_gap(corners, lattice.crossings[lattice.present]) < 1.0


def room_corner(rng, cells=(7, 6)):
    """Two boards that meet at a fold, with their cells continuing across it."""
    camera = simulate.TrueCamera(1200.0, 1200.0, 640.0, 480.0, [-0.2, 0.03, 0, 0, 0])
    lean = cv2.Rodrigues(np.array([0.35, 0.0, rng.uniform(-0.2, 0.2)]))[0]
    columns, rows = cells
    down = lean @ [0.0, 1.0, 0.0]
    fold = np.array([0.0, 0.0, 24.0])
    targets = []
    for side, turn in ((-1.0, 0.9), (1.0, -0.6)):
        along = lean @ [np.cos(turn), 0.0, np.sin(turn)]
        rotation = np.column_stack([along, down, np.cross(along, down)])
        centre = fold + 0.5 * side * columns * along
        inner = (columns - 1, rows - 1)
        targets.append(simulate.Target(rotation, centre, "chessboard", inner_corners=inner))
    return simulate.Scene(camera, tuple(targets))


@pytest.mark.parametrize("seed", first_quick(range(2)))
@pytest.mark.parametrize("columns", [6, 7])
def test_boards_that_meet_at_a_fold_are_two_planes(columns, seed):
    """With 6 columns the cells alternate across the fold, with 7 each meets one of its shade."""
    rng = np.random.default_rng([82, seed])
    scene = room_corner(rng, (columns, 6))
    lattices = find_lattices(simulate.render(scene, rng, noise=3.0))
    assert len(lattices) == 2
    lattices.sort(key=lambda lattice: lattice.crossings[lattice.present][:, 0].mean())
    for number, lattice in enumerate(lattices):
        truth = scene.image_points(number, scene.targets[number].board_corners())
        assert worst_gap(truth, lattice.crossings[lattice.present]) < 2.0
        half = 0.5 * columns  # including the fold's own crossings, which belong to both boards
        rim = np.stack(
            np.meshgrid(np.arange(columns + 1) - half, np.arange(7) - 3.0), axis=-1
        ).reshape(-1, 2)
        plane = scene.image_points(number, rim)
        assert worst_gap(lattice.crossings[lattice.present], plane) < 2.0


@needs_data
def test_planes_of_the_room_corner():
    for name in ("left", "right"):
        grey = cv2.imread(str(DATA / "ortho-corner" / f"{name}_calib.jpg"), cv2.IMREAD_GRAYSCALE)
        lattices = find_lattices(grey)
        assert len(lattices) == 3
        assert all(np.count_nonzero(lattice.present) >= 40 for lattice in lattices)


@needs_data
def test_faces_of_the_cube_with_markers_in_its_light_cells():
    records = json.loads((DATA / "charuco-cube" / "corners_cam0.json").read_text())
    for number, faces in ((7, 3), (8, 3), (19, 1)):
        path = DATA / "charuco-cube" / "cam0" / f"{number}.jpg"
        lattices = find_lattices(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        assert len(lattices) == faces
        for record in records:
            if record["image"] != f"cam0/{number}.jpg":
                continue
            corners = np.array(record["corners_xy"])
            gaps = [
                np.linalg.norm(corners[:, None] - lattice.crossings[lattice.present], axis=2)
                for lattice in lattices
            ]
            # The corners are from another detector, and the markers disturb both.
            assert max(np.mean(gap.min(axis=1) < 1.5) for gap in gaps) > 0.85


def test_a_board_in_a_picture_wider_than_opencv_maps():
    board = np.kron(np.indices((7, 9)).sum(axis=0) % 2, np.ones((30, 30)))
    part = cv2.GaussianBlur(np.pad(255 - 215 * board, 45, constant_values=255), (0, 0), 0.8)
    part = part.astype(np.uint8)
    wide = np.full((300, 33_000), 255, np.uint8)
    wide[: part.shape[0], 32_000 : 32_000 + part.shape[1]] = part
    (alone,) = ts.detect(part, targets="chessboard:8x6")
    (found,) = ts.detect(wide, targets="chessboard:8x6")
    np.testing.assert_array_equal(found.lines, alone.lines)
    here, there = (np.concatenate(one.points).mean(axis=0) for one in (alone, found))
    np.testing.assert_allclose(there - [32_000, 0], here, atol=3)
