"""Pieces of boards: told apart at a fold, put together where they continue each other."""

import cv2
import numpy as np
import pytest

from trisquare import simulate
from trisquare.detection.boards.find import find_lattices
from trisquare.detection.boards.grids import Grid
from trisquare.detection.boards.merging import joined, with_neighbours
from trisquare.detection.boards.outliers import smooth_parts
from trisquare.detection.boards.surface import Surface

SHAPE = (960, 1280)
CAMERA = simulate.TrueCamera(1100.0, 1100.0, 640.0, 480.0, [-0.25, 0.06, 0, 0, 0])


def board(turn, centre=(0.0, 0.0, 30.0)):
    """A board of 10 x 8 crossings, turned about an axis aslant."""
    rotation = cv2.Rodrigues(np.radians(turn) * np.array([0.6, 0.8, 0.0]))[0]
    return simulate.Target(rotation, np.array(centre), "chessboard", inner_corners=(10, 8))


def crossings(target, columns, rows, rng=None):
    """Grid of a board's crossings in ranges of columns and rows, with noise of 0.1 pixels."""
    sites = np.stack(np.meshgrid(columns, rows), axis=-1).astype(float)
    scene = simulate.Scene(CAMERA, (target,))
    points = scene.image_points(0, (sites - [4.5, 3.5]).reshape(-1, 2)).reshape(sites.shape)
    if rng is not None:
        points = points + rng.normal(0.0, 0.1, points.shape)
    return Grid(points, (columns[0] + rows[0]) % 2 == 0)


def turned(grid):
    """The same crossings with the last column as the first row."""
    columns = grid.points.shape[1]
    return Grid(np.rot90(grid.points), grid.dark_first == (columns % 2 == 0))


def test_a_surface_has_every_crossing_of_a_bent_board():
    grid = crossings(board(25.0, (-3.0, -2.0, 20.0)), range(10), range(8))
    part = Grid(grid.points[1:7, 1:9], True)
    surface = Surface.of(part, SHAPE)
    sites = np.stack(np.meshgrid(np.arange(-1.0, 9.0), np.arange(-1.0, 7.0)), axis=-1)
    # A cell is 50 pixels wide, and the lens bends the rows by some pixels.
    assert np.linalg.norm(surface.at(sites) - grid.points, axis=2).max() < 1.0
    assert surface.bend < -0.05
    assert surface.deviations(part).max() < 0.3
    inside = sites[1:7, 1:9].reshape(-1, 2)
    assert np.abs(surface.sites(surface.at(inside)) - inside).max() < 1e-8


def test_a_row_of_another_board_is_left_out():
    rng = np.random.default_rng(90)
    own = crossings(board(30.0), range(10), range(8), rng)
    # A row beyond a fold is nearer than the next one of the board would be.
    step = own.points[-1] - own.points[-2]
    points = np.concatenate([own.points, own.points[-1:] + 0.6 * step])
    (part,) = smooth_parts(Grid(points, True), SHAPE)
    assert np.array_equal(part.points, own.points)


def test_rows_on_both_sides_of_a_fold_are_no_part():
    """What bends freely, as a polynomial does, passes through any three rows."""
    rng = np.random.default_rng(91)
    own = crossings(board(30.0), range(10), range(8), rng)
    # The cell that the fold divides is longer than those on either side.
    alien = [own.points[-1:] + part * (own.points[-1] - own.points[-2]) for part in (1.6, 2.2)]
    parts = smooth_parts(Grid(np.concatenate([own.points, *alien]), True), SHAPE)
    assert max(np.count_nonzero(part.present) for part in parts) == own.present.sum()
    for part in parts:
        rows = [np.abs(own.points - point).max(axis=2).min() < 1e-9 for point in part.points[:, 0]]
        assert all(rows) or not any(rows)


def test_a_stray_is_left_out():
    points = crossings(board(30.0), range(10), range(8), np.random.default_rng(92)).points.copy()
    points[0, 3] += [4.0, 2.0]
    (part,) = smooth_parts(Grid(points, True), SHAPE)
    assert np.argwhere(~part.present).tolist() == [[0, 3]]


@pytest.mark.parametrize("quarters", range(4))
def test_pieces_of_a_board_are_joined_whichever_way_they_are_turned(quarters):
    rng = np.random.default_rng([93, quarters])
    target = board(35.0)
    first = crossings(target, range(4), range(8), rng)
    second = crossings(target, range(6, 10), range(3, 8), rng)
    for _ in range(quarters):
        second = turned(second)
    (whole,) = joined([second, first], [], SHAPE)
    truth = crossings(target, range(10), range(8))
    assert whole.present.shape == (8, 10)
    assert whole.present.sum() == 32 + 20
    assert np.linalg.norm(whole.points - truth.points, axis=2)[whole.present].max() < 0.5
    assert whole.dark_first == truth.dark_first


def test_scraps_are_joined_or_left_out():
    rng = np.random.default_rng(94)
    target = board(35.0)
    host = crossings(target, range(6), range(8), rng)
    scrap = crossings(target, range(7, 9), range(2, 5), rng)
    strange = crossings(board(-20.0, (14.0, 0.0, 30.0)), range(2), range(3), rng)
    (whole,) = joined([host], [strange, scrap], SHAPE)
    assert whole.present.sum() == 48 + 6


def test_what_contradicts_is_not_joined():
    rng = np.random.default_rng(95)
    target = board(35.0)
    host = crossings(target, range(4), range(8), rng)
    piece = crossings(target, range(6, 10), range(8), rng)
    swapped = Grid(piece.points, not piece.dark_first)  # its dark cells where light ones must be
    assert len(joined([host, swapped], [], SHAPE)) == 1  # the host's own crossings, linked wrongly
    assert joined([host, swapped], [], SHAPE)[0].present.sum() == host.present.sum()
    between = Grid(piece.points + 0.5 * (piece.points[0, 1] - piece.points[0, 0]), True)
    assert len(joined([host, between], [], SHAPE)) == 2
    folded = crossings(board(-25.0, (3.0, 0.0, 30.0)), range(6, 10), range(8), rng)
    assert len(joined([host, folded], [], SHAPE)) == 2


def test_every_second_row_is_no_lattice_of_its_own():
    target = board(20.0)
    host = crossings(target, range(10), range(8))
    second = crossings(target, range(10), range(8, 14, 2))
    assert len(joined([host, Grid(second.points, True)], [], SHAPE)) == 1


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


def test_neighbours_are_foretold_where_the_board_has_them():
    target = board(30.0)
    whole = crossings(target, range(10), range(8))
    inner = Grid(whole.points[1:-1, 1:-1], whole.dark_first)
    wider = with_neighbours(inner, SHAPE)
    ring = wider.present & ~np.pad(inner.present, 1)
    assert ring.sum() == 2 * 8 + 2 * 6  # without corners, which are next to none
    assert np.linalg.norm(wider.points - whole.points, axis=2)[ring].max() < 1.0


def test_faint_crossings_are_found_by_their_neighbours():
    """A row whose contrast is a tenth has no saddles to find, but cells that alternate."""
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
