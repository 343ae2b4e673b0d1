"""A calibration that succeeds names the squares that it could not use, and no clutter."""

import cv2
import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate

FINGER_GREY = 150


def photograph(seed, count, clutter=6):
    rng = np.random.default_rng(seed)
    scene = simulate.random_scene(rng, kind=("square", "frame")[seed % 2], count=count)
    return simulate.render(scene, rng, tone="srgb", noise=2.0, clutter=clutter)


def printed_of(run, folder, picture, *options):
    """Lines on what was not used, of a picture that calibrates."""
    photo = folder / "photo.png"
    cv2.imwrite(str(photo), picture)
    code, printed, _ = run("calibrate", photo, *options)
    assert code == 0
    return [line.strip() for line in printed.splitlines() if "not used: " in line]


def with_finger(picture, square):
    """Cover 40 % of side 0 of a square, corners of shape (4, 2)."""
    middle, along = square[:2].mean(axis=0), square[1] - square[0]
    side = np.linalg.norm(along)
    out = (middle - square.mean(axis=0)) / np.linalg.norm(middle - square.mean(axis=0))
    centre = np.rint(middle + 0.35 * side * out).astype(int).tolist()
    axes = (int(0.6 * side), int(0.2 * side))
    angle = np.degrees(np.arctan2(out[1], out[0]))
    return cv2.ellipse(picture.copy(), centre, axes, angle, 0, 360, FINGER_GREY, -1, cv2.LINE_AA)


@pytest.mark.parametrize("seed", [906, 911])
def test_a_square_under_a_finger_is_named(run, tmp_path, seed):
    picture = photograph(seed, 4)
    square = ts.calibrate(picture).planes[1].corners
    (line,) = printed_of(run, tmp_path, with_finger(picture, square))
    x, y = square.mean(axis=0)
    places = [f"({x + dx:.0f}, {y + dy:.0f})" for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    assert line.startswith("not used: quad around (")
    assert any(
        f"{place} of picture 0: one of its sides is not a smooth edge" in line for place in places
    ), line


def left_one_cut(picture, targets="auto"):
    """A picture without what lies left of the middle of its leftmost target, but for 40 px."""
    planes = ts.calibrate(picture, targets=targets).planes
    left = min((plane.corners for plane in planes), key=lambda corners: corners[:, 0].min())
    return picture[:, int(left[:, 0].mean()) - 40 :]


def test_a_square_that_the_border_cuts_is_named(run, tmp_path):
    (line,) = printed_of(run, tmp_path, left_one_cut(photograph(903, 4)))
    assert line.endswith("of picture 0: it is cut by the picture's border")


@pytest.mark.parametrize("count", [3, 4])
def test_a_sheet_that_the_border_cuts_is_named(run, tmp_path, count):
    rng = np.random.default_rng(903)
    scene = simulate.random_scene(rng, count=count, aspect=297 / 210, dark=False)
    cut = left_one_cut(simulate.render(scene, rng, tone="srgb", noise=2.0), "a4")
    (line,) = printed_of(run, tmp_path, cut, "--targets", "a4")
    assert line.endswith("of picture 0: it is cut by the picture's border")


def test_clutter_is_not_named(run, tmp_path):
    named = [printed_of(run, tmp_path, photograph(seed, 3)) for seed in range(300, 310)]
    assert sum(map(bool, named)) <= 1, named
