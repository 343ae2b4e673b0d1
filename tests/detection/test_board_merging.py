"""Pieces of boards: joined where they continue each other, completed where they are faint."""

import cv2
import numpy as np
import pytest
from quick import first_quick

from trisquare import simulate
from trisquare.detection.boards.find import find_lattices

CAMERA = simulate.TrueCamera(1100.0, 1100.0, 640.0, 480.0, [-0.25, 0.06, 0, 0, 0])


def board(turn, centre=(0.0, 0.0, 30.0)):
    """A board of 10 x 8 crossings, turned about an oblique axis."""
    rotation = cv2.Rodrigues(np.radians(turn) * np.array([0.6, 0.8, 0.0]))[0]
    return simulate.Target(rotation, np.array(centre), "chessboard", inner_corners=(10, 8))


def test_a_board_behind_an_arm_is_one_lattice():
    target = simulate.Target(
        board(30.0).rotation, np.array([0.0, 0.0, 26.0]), "chessboard", inner_corners=(13, 8)
    )
    scene = simulate.Scene(CAMERA, (target,))
    picture = simulate.render(scene, np.random.default_rng(96), noise=3.0)
    hidden = scene.image_points(0, np.array([[-0.7, -6.0], [2.2, -6.0], [2.2, 6.0], [-0.7, 6.0]]))
    cv2.fillConvexPoly(picture, np.rint(hidden).astype(np.int32), 120)
    (lattice,) = find_lattices(picture)
    assert sorted(lattice.present.shape) == [8, 13]
    truth = scene.image_points(0, target.board_corners())
    found = lattice.crossings[lattice.present]
    assert len(found) >= 13 * 8 - 4 * 8
    assert np.linalg.norm(found[:, None] - truth, axis=2).min(axis=1).max() < 1.5


def test_faint_crossings_are_found_by_their_neighbours():
    """A row with a tenth of the contrast has no detectable saddles, but its cells alternate."""
    scene = simulate.Scene(CAMERA, (board(15.0),))
    picture = simulate.render(scene, np.random.default_rng(97), noise=0.5, shading=0.0)
    faded = scene.image_points(0, np.array([[-5.6, 3.1], [5.6, 3.1], [5.6, 4.0], [-5.6, 4.0]]))
    mask = np.zeros_like(picture)
    cv2.fillConvexPoly(mask, np.rint(faded).astype(np.int32), 1)
    picture = np.where(mask > 0, 120 + 0.1 * (picture - 120.0), picture).astype(np.uint8)
    (lattice,) = find_lattices(picture)
    assert sorted(lattice.present.shape) == [8, 10]
    assert lattice.present.all()
    truth = scene.image_points(0, scene.targets[0].board_corners())
    gaps = np.linalg.norm(truth[:, None] - lattice.crossings.reshape(-1, 2), axis=2)
    assert gaps.min(axis=1).max() < 1.5


def two_boards(turn, corners, offset):
    """Two boards of `corners` with centres `offset` cells apart, on one plane."""
    rotation = cv2.Rodrigues(np.radians(turn) * np.array([0.6, 0.8, 0.0]))[0]
    way = rotation[:, :2] @ np.array(offset, dtype=float)
    targets = tuple(
        simulate.Target(
            rotation,
            np.array([0.0, 0.0, 30.0]) + 0.5 * side * way,
            "chessboard",
            inner_corners=corners,
        )
        for side in (-1.0, 1.0)
    )
    return simulate.Scene(CAMERA, targets)


@pytest.mark.parametrize(
    ("turn", "corners", "offset"),
    first_quick(
        [
            (25.0, (6, 7), (8.0, 0.0)),  # in one lattice, with cells of the same shade
            (0.0, (7, 5), (11.0, 0.0)),  # in one lattice, with shades swapped
            (0.0, (7, 5), (9.0, 1.0)),  # four crossings opposite each other
            (25.0, (6, 7), (7.8, 0.0)),
            (25.0, (6, 7), (9.0, 0.0)),
        ],
        3,
    ),
)
def test_boards_side_by_side_are_two(turn, corners, offset):
    picture = simulate.render(
        two_boards(turn, corners, offset), np.random.default_rng(98), noise=3.0
    )
    lattices = find_lattices(picture)
    assert len(lattices) == 2
    assert all(np.count_nonzero(lattice.present) == corners[0] * corners[1] for lattice in lattices)
