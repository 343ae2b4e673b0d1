"""Grid lines of chessboards: measured through their crossings, even on incomplete boards."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import trisquare as ts
import trisquare._core as _core
from trisquare import simulate
from trisquare.detection.candidates import Lattice
from trisquare.measurement.boards import Board

NAMES = ("fx", "fy", "cx", "cy")


def board_scene(seed, inner_corners, **options):
    rng = np.random.default_rng([91, seed])
    scene = simulate.random_scene(rng, **options)
    size = (inner_corners, inner_corners)
    boards = tuple(
        replace(
            t,
            translation=(inner_corners + 1) * t.translation,
            kind="chessboard",
            inner_corners=size,
        )
        for t in scene.targets
    )
    return replace(scene, targets=boards), rng


def true_lattice(scene, target, rng, error=0.5):
    columns, rows = scene.targets[target].inner_corners
    points = scene.image_points(target, scene.targets[target].board_corners())
    crossings = points.reshape(rows, columns, 2) + rng.normal(0, error, (rows, columns, 2))
    return Lattice(crossings, np.ones((rows, columns), dtype=bool))


def measured(picture, lattices, tone="linear"):
    found = [Board.of(lattice, picture) for lattice in lattices]
    spans, ends = [], [0]
    for lattice in found:
        spans += lattice.spans(len(spans))
        ends.append(len(spans))
    samples, *_ = _core.localise(_core.Picture(picture), spans, tone)
    return [
        figure
        for plane, lattice in enumerate(found)
        for figure in lattice.figures(samples[ends[plane] : ends[plane + 1]], plane)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inner_corners", "blur"),
    [(4, 0.6), (8, 1.0), (8, 1.5), (18, 0.8)],
    ids=["large cells", "usual", "blurred", "15-pixel cells"],
)
def test_boards_reach_the_bound_of_their_grid_lines(inner_corners, blur):
    """The stated stds are near the bound of all pixels, and the errors agree with them."""
    scene, rng = board_scene(1, inner_corners)
    picture = simulate.render(scene, rng, noise=2.0, blur=blur, contrast=175.0, tone="linear")
    figures = measured(picture, [true_lattice(scene, i, rng) for i in range(3)])
    result = ts.calibrate_edges(figures, scene.camera.image_size)
    bound = simulate.cramer_rao_bound(scene, simulate.pixel_sigma(2.0, 175.0, blur))
    for name in NAMES:
        assert 0.9 < result.std[name] / bound[name] < 1.3
        assert abs(getattr(result.camera, name) - getattr(scene.camera, name)) < (
            4.0 * result.std[name]
        )


def test_hidden_and_missing_crossings_leave_the_rest_as_good():
    """A hand covers a part, where the search found no crossings."""
    scene, rng = board_scene(2, 6, image_size=(800, 600))
    picture = simulate.render(scene, rng, noise=1.0, blur=0.8, contrast=175.0, tone="linear")
    lattices = [true_lattice(scene, i, rng) for i in range(3)]
    hidden = lattices[0].crossings[2:4, 2:5].reshape(-1, 2)
    low, high = np.floor(hidden.min(axis=0)).astype(int), np.ceil(hidden.max(axis=0)).astype(int)
    picture[low[1] - 6 : high[1] + 7, low[0] - 6 : high[0] + 7] = 140
    for row, column in np.ndindex(6, 6):
        x, y = lattices[0].crossings[row, column]
        if low[0] - 10 < x < high[0] + 10 and low[1] - 10 < y < high[1] + 10:
            lattices[0].present[row, column] = False
    figures = measured(picture, lattices)
    result = ts.calibrate_edges(figures, scene.camera.image_size)
    for name in NAMES:
        assert abs(getattr(result.camera, name) - getattr(scene.camera, name)) < (
            4.0 * result.std[name]
        )
    assert result.planes[0].rms < 0.05


def test_shade_is_judged_by_the_whole_board():
    """Neither the choice of the first cell nor a wrong tone curve moves the lines."""
    scene, rng = board_scene(3, 5)
    picture = simulate.render(scene, rng, noise=1.0, blur=0.8, contrast=175.0, tone="srgb")
    lattices = [true_lattice(scene, i, rng) for i in range(3)]
    cut = [Lattice(a.crossings[:, 1:], a.present[:, 1:]) for a in lattices]
    for some in (lattices, cut):
        figures = measured(picture, some, tone="linear")
        assert all(len(figure.lines) == sum(some[0].present.shape) for figure in figures)
        result = ts.calibrate_edges(figures, scene.camera.image_size)
        error = result.camera.fx - scene.camera.fx
        assert abs(error) < 4.0 * result.std["fx"] < 0.01 * scene.camera.fx


@pytest.mark.parametrize("ratio", [0.5, 0.6, 0.7, 0.85])
@pytest.mark.parametrize("codes", [cv2.aruco.DICT_4X4_250, cv2.aruco.DICT_7X7_250])
def test_the_black_border_of_markers_is_no_dark_cell(codes, ratio):
    """With 4 x 4 cells and a ratio of 0.6, it is about a quarter of a cell from the edge."""
    dictionary = cv2.aruco.getPredefinedDictionary(codes)
    board = cv2.aruco.CharucoBoard((8, 6), 1.0, ratio, dictionary).generateImage((640, 480))
    crossings = 80.0 * np.stack(np.meshgrid(np.arange(1.0, 8.0), np.arange(1.0, 6.0)), axis=-1)
    lattice = Lattice(crossings - 0.5, np.ones((5, 7), dtype=bool))
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0.0, 3.0, board.shape)
        grey = (30.0 + 0.7 * board + noise).astype(np.uint8)
        # The cell after the first crossing, below its row, is as dark as the board's first.
        assert Board.of(lattice, grey).contrast_sign == (-1.0 if board[4, 4] == 0 else 1.0)


def test_stray_parts_of_a_lattice_are_no_lines():
    """A row of only separate crossings has no span; one beyond the columns has its own."""
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1)
    present = np.ones((5, 6), dtype=bool)
    present[4] = [True, False, True, False, False, True]
    lattice = Lattice(20.0 * grid + 30.0, present)
    found = Board(lattice, 1.0)
    spans = found.spans(7)
    assert len(spans) == 4 + 6
    first = spans[0]
    assert first.path.shape == (6, 2)
    assert first.bounds == (None, None)
    assert first.crossings == [(11 + column, column) for column in range(6)]
    assert first.polarity == 1.0
    assert spans[1].polarity == -1.0
    # The first column extends to the crossing in the last row, which is not a line.
    assert spans[4].crossings[-1] == (None, 4)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_flat_pictures_have_no_lines(value):
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1)
    lattice = Lattice(12.0 * grid + 4.0, np.ones((5, 5), dtype=bool))
    for picture in (np.full((64, 64), value, np.uint8), np.full((1, 1), value, np.uint8)):
        assert measured(picture, [lattice]) == []


def test_noise_and_coinciding_crossings_are_refused_by_line():
    rng = np.random.default_rng(5)
    picture = rng.integers(0, 255, (80, 80), dtype=np.uint8)
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1)
    everywhere = np.ones((5, 5), dtype=bool)
    measured(picture, [Lattice(12.0 * grid + 4.0, everywhere)])
    assert measured(picture, [Lattice(np.full((5, 5, 2), 40.0), everywhere)]) == []
