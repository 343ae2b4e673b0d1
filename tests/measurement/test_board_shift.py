"""The shift of a board's edges toward the dark, measured from their zigzag."""

import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare.measurement.board_shift import (
    shift_and_std,
    shift_toward_light,
    shifts_of_lines,
    without_shift,
)

NOISE = 0.05


def zigzag(shift, rng, lines=9, per_cell=6, cells=8):
    """Return gently bent grid lines whose cells are shifted alternately."""
    found = []
    for line in range(lines):
        x = np.linspace(0.0, 200.0, per_cell * cells)
        rises = np.repeat([1.0, -1.0] * (cells // 2), per_cell) * (-1.0) ** line
        y = 20.0 * line + 1e-4 * (x - 90.0) ** 2 + shift * rises
        points = np.stack([x, y + rng.normal(0, NOISE, x.size)], axis=1)
        found.append((points, np.full(x.size, NOISE), rises))
    return found


@pytest.mark.parametrize("shift", [-0.4, 0.0, 0.25])
def test_the_shift_of_bent_lines_is_found(shift):
    lines = zigzag(shift, np.random.default_rng(1))
    found = shift_toward_light(lines)
    std = NOISE / np.sqrt(sum(len(points) for points, _, _ in lines))
    assert abs(found - shift) < 4 * std
    points, _, rises = lines[0]
    moved = without_shift(points, rises, found)
    assert np.abs(moved[:, 1] - points[:, 1] + found * rises).max() < 0.01


def test_a_tenth_of_outliers_hardly_matters():
    rng = np.random.default_rng(2)
    lines = zigzag(0.25, rng)
    for points, _, rises in lines:
        spoilt = rng.random(len(points)) < 0.1
        points[spoilt, 1] -= 2.0 * rises[spoilt]
    assert abs(shift_toward_light(lines) - 0.25) < 0.05


def test_long_lines_keep_a_shift_of_their_own():
    rng = np.random.default_rng(4)
    lines = zigzag(0.1, rng, per_cell=12) + zigzag(0.3, rng, per_cell=12)
    own = shifts_of_lines(lines, 0.2, evident=False)
    assert abs(own[:9].mean() - 0.1) < 0.02
    assert abs(own[9:].mean() - 0.3) < 0.02


def test_lines_that_differ_by_chance_have_the_board_s_shift():
    lines = zigzag(0.1, np.random.default_rng(5))
    each = np.array([shift_toward_light([line]) for line in lines])
    own = shifts_of_lines(lines, 0.1, evident=False)
    assert np.std(own - 0.1) < 0.5 * np.std(each - 0.1)


def test_lines_of_two_cells_are_left_to_the_board_and_never_run_away():
    """Each one's own shift would turn it: its zigzag is a tilt but for the samples midway."""
    rng = np.random.default_rng(6)
    lines = zigzag(0.0, rng, lines=20, per_cell=4, cells=2)
    np.testing.assert_array_equal(shifts_of_lines(lines, 0.01, evident=False), 0.01)
    three = zigzag(0.0, rng, lines=20, per_cell=2, cells=2)
    assert np.abs(shifts_of_lines(three, 0.0, evident=True)).max() < 10 * NOISE


def test_one_cell_alone_says_nothing():
    points = np.stack([np.arange(6.0), np.zeros(6)], axis=1)
    points[2, 1] = 1e-3
    assert shift_toward_light([(points, np.ones(6), np.ones(6))]) == 0.0


def test_few_cells_tell_a_shift_less_well_than_many():
    rng = np.random.default_rng(4)
    std = [shift_and_std(zigzag(0.3, rng, lines=1, cells=cells))[1] for cells in (2, 8, 16)]
    assert std[0] > 3.0 * std[1] > 3.0 * std[2] > 0.0
    x = np.arange(6.0)
    alike = (np.stack([x, 0.3 * x], axis=1), np.ones(6), np.ones(6))
    assert shift_and_std([alike]) == (0.0, np.inf)


@pytest.mark.slow
def test_a_wrong_tone_curve_no_longer_tears_the_lines_of_a_board():
    def zigzag_of(picture, tone):
        (board,) = ts.detect(picture, targets="chessboard:9x6", tone=tone)
        bends = []
        for points in board.points:
            x, y = (points - points.mean(axis=0)).T
            along, across = (x, y) if np.ptp(x) > np.ptp(y) else (y, x)
            bends.append(across - np.polyval(np.polyfit(along, across, 4), along))
        return np.std(np.concatenate(bends))

    ratios = []
    for seed in range(3, 8):
        rng = np.random.default_rng(seed)
        scene = simulate.chessboard_scene(rng, simulate.random_camera(rng))
        picture = simulate.render(scene, rng, noise=2.0, blur=0.8, tone="srgb")
        ratios.append(zigzag_of(picture, "linear") / zigzag_of(picture, "srgb"))
    # About crossings a little is left, the more the flatter a board is looked at: half of them
    # stay below 1.1.
    assert np.median(ratios) < 1.3
