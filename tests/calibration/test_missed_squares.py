"""A successful calibration names the squares that it could not use, and no clutter."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare.results.rejected import CUT_BY_BORDER

FINGER_GREY = 150


def photograph(seed, count, clutter=6):
    rng = np.random.default_rng(seed)
    scene = simulate.random_scene(rng, kind=("square", "frame")[seed % 2], count=count)
    return simulate.render(scene, rng, tone="srgb", noise=2.0, clutter=clutter)


def printed_of(run, folder, picture, *options):
    """The lines of the output on unused targets, for a picture that calibrates."""
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
    """A picture cut 40 px left of the middle of its leftmost target."""
    planes = ts.calibrate(picture, targets=targets).planes
    left = min((plane.corners for plane in planes), key=lambda corners: corners[:, 0].min())
    return picture[:, int(left[:, 0].mean()) - 40 :]


def test_squares_that_the_border_cuts_are_named(run, tmp_path):
    """Two of four squares are at the left."""
    lines = printed_of(run, tmp_path, left_one_cut(photograph(903, 4)))
    assert len(lines) == 2
    assert all(line.endswith("of picture 0: it is cut by the picture's border") for line in lines)


def with_glare(picture, place, reach):
    """Add the light of a lamp, clipped at white, around a position in the picture."""
    y, x = np.ogrid[: picture.shape[0], : picture.shape[1]]
    light = 600.0 * np.exp(-2.0 * ((x - place[0]) ** 2 + (y - place[1]) ** 2) / reach**2)
    return np.clip(picture + light, 0, 255).astype(np.uint8)


def third_of_three(picture, spoilt):
    """The third target, left of the others, as reported by a result from two squares."""
    assert len(ts.calibrate(picture).planes) == 3
    found = ts.calibrate(spoilt)
    assert len(found.planes) == 2
    (third,) = found.rejected
    assert ts.Calibration.from_json(found.to_json()).rejected[0].reason == third.reason
    return third


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_of_two_squares_the_result_has_the_third_that_the_border_cuts(seed):
    picture = photograph(seed, 3)
    third = third_of_three(picture, np.ascontiguousarray(left_one_cut(picture)))
    assert third.reason == CUT_BY_BORDER
    assert third.corners[:, 0].min() < 10


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_of_two_squares_the_result_has_the_third_that_glare_is_over(seed):
    picture = photograph(seed, 3)
    found = [plane.corners for plane in ts.calibrate(picture).planes]
    corners = min(found, key=lambda corners: corners[0, 0])
    third = third_of_three(picture, with_glare(picture, corners[:2].mean(axis=0), reach=90))
    assert third.reason == "one of its sides is not a smooth edge"
    assert np.linalg.norm((third.corners - corners).mean(axis=0)) < 30


def test_of_two_squares_the_result_has_no_clutter():
    named = 0
    for seed in range(300, 310):
        rng = np.random.default_rng(seed)
        scene = simulate.random_scene(rng)
        scene = replace(scene, targets=scene.targets[:2])
        picture = simulate.render(scene, rng, tone="srgb", noise=2.0, clutter=40)
        named += bool(ts.calibrate(picture).rejected)
    assert named <= 1


@pytest.mark.parametrize("count", [3, 4])
def test_a_sheet_that_the_border_cuts_is_named(run, tmp_path, count):
    rng = np.random.default_rng(903)
    scene = simulate.random_scene(rng, count=count, aspect=297 / 210, dark=False)
    cut = left_one_cut(simulate.render(scene, rng, tone="srgb", noise=2.0), "a4")
    lines = printed_of(run, tmp_path, cut, "--targets", "a4")
    assert len(lines) == {3: 1, 4: 2}[count]
    assert all(line.endswith("of picture 0: it is cut by the picture's border") for line in lines)


def test_clutter_is_not_named(run, tmp_path):
    named = [printed_of(run, tmp_path, photograph(seed, 3)) for seed in range(300, 310)]
    assert sum(map(bool, named)) <= 1, named
