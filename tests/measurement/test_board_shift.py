"""The shift of a board's edges towards the dark, measured from their zigzag."""

import numpy as np
import pytest

import trisquare as ts
import trisquare._core as _core
from trisquare import simulate


def line_of(shift, count=48):
    x = np.linspace(0.0, 200.0, count)
    cells = np.arange(count) // 6
    y = 1e-4 * (x - 90.0) ** 2 + shift * (1.0 - 2.0 * (cells % 2))
    return np.stack([x, y], axis=1), np.full(count, 0.05), cells, 1.0


def test_the_shift_of_a_zigzag_is_taken_out():
    lines, shift = _core.remove_edge_shift([line_of(0.03), line_of(0.03)])
    assert abs(shift - 0.03) < 1e-3
    for points, std, cells in lines:
        assert np.abs(points - line_of(0.0)[0]).max() < 1e-3
        assert std.shape == (48,)
        assert np.array_equal(cells, line_of(0.0)[2])


def test_a_shift_that_grows_along_the_line_is_taken_out():
    # Ink that spreads evenly on a board that is nearer at one end; one line has another shift.
    def line(shift):
        points, *rest = line_of(shift)
        flat = line_of(0.0)[0]
        growth = np.linspace(0.8, 1.2, len(points))
        points[:, 1] = flat[:, 1] + growth * (points[:, 1] - flat[:, 1])
        return points, *rest

    lines, shift = _core.remove_edge_shift([line(0.1)] * 7 + [line(0.2)])
    assert abs(shift - 0.1) < 0.01
    for points, _, _ in lines:
        assert np.abs(points - line_of(0.0)[0]).max() < 5e-3


def test_samples_that_are_left_out_take_their_cells_with_them():
    points, std, cells, sign = line_of(0.3)
    std[::6] *= 1.5  # next to a crossing
    lines, shift = _core.remove_edge_shift([(points, std, cells, sign)] * 2)
    assert abs(shift - 0.3) < 0.01
    for points, std, kept in lines:
        assert len(points) == len(std) == len(kept) == 40
        assert np.array_equal(kept, np.delete(cells, np.s_[::6]))


@pytest.mark.parametrize("wrong", range(3))
def test_lines_that_are_none_are_refused(wrong):
    points, std, cells, sign = line_of(0.1)
    line = [
        (points[:1], std[:1], cells[:1], sign),
        (points, std[1:], cells, sign),
        (points, std, -cells, sign),
    ][wrong]
    with pytest.raises((ValueError, OverflowError)):
        _core.remove_edge_shift([line])


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
    # A remainder is left near crossings, which grows with the tilt of a board: half of the boards
    # stay below 1.1.
    assert np.median(ratios) < 1.3
