"""Squares in front of a chessboard are found, but not the board's own cells and its sheet."""

from functools import cache

import numpy as np
import pytest
from quick import first_quick

from trisquare import simulate
from trisquare.detection.kinds import TargetKinds
from trisquare.measurement.find import search
from trisquare.simulate.render import render_into

SIZE = (1280, 960)
INNER_CORNERS = (9, 6)

# The mean of a tilted square's corners is some pixels from the image of its centre.
NEAR = 30.0


@cache
def board_picture(seed):
    rng = np.random.default_rng([81, seed])
    camera = simulate.random_camera(rng, SIZE)
    scene = simulate.chessboard_scene(rng, camera, inner_corners=INNER_CORNERS)
    picture = simulate.render(scene, rng, noise=2.0)
    picture.flags.writeable = False
    return picture


@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_a_board_alone_gives_no_squares(seed):
    found = search(board_picture(seed), TargetKinds.parse("auto")).found
    assert [target.kind for target in found] == ["chessboard"]


@pytest.mark.parametrize("kind", ["square", "frame"])
@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_three_squares_before_a_board_are_found_and_nothing_else(kind, seed):
    rng = np.random.default_rng([82, seed])
    scene = simulate.random_scene(rng, image_size=SIZE, kind=kind)
    picture = render_into(board_picture(seed), scene, rng)
    found = search(picture, TargetKinds.parse("auto")).found
    squares = [target for target in found if target.kind != "chessboard"]
    truth = np.array([scene.image_points(i, np.zeros((1, 2)))[0] for i in range(3)])
    assert len(squares) == 3
    gaps = np.array([np.linalg.norm(truth - one.quad.mean(axis=0), axis=1) for one in squares])
    assert sorted(gaps.argmin(axis=1)) == [0, 1, 2]
    assert gaps.min(axis=1).max() < NEAR
