"""Choice of the squares in a picture that one camera explains."""

import itertools

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE, assert_within, edges_of, squares

import trisquare as ts
import trisquare._core as _core
from trisquare import simulate
from trisquare._support.rotations import tilted
from trisquare.calibration.select import chosen_planes
from trisquare.simulate.scene import Scene, rectangle
from trisquare_scenes.distractors import mixed_scene, photograph

# Threshold in standard deviations of a statistic, exceeded by chance once in fifteen thousand runs.
SURE = 4.0

# A false square this close to a true one may be accepted: the noise hides the difference.
HARDLY_FALSE = 0.12

NOISE = 0.05
WORDS_OF_DOUBT = ("choice", "contradict", "disagree", "rejected")


def chosen_among(figures, size, quads, fixed=()):
    outcome = _core.calibrate(
        figures,
        size,
        choosing=True,
        method="ml",
        model="radial2",
        fixed=fixed,
        initial=None,
        pictures=None,
        tones=[],
    )
    return chosen_planes(outcome, figures, quads)


def chosen(figures, quads=None, fixed=()):
    quads = quads or {figure.plane: np.eye(4, 2) for figure in figures}
    return chosen_among(figures, IMAGE_SIZE, quads, fixed)


def planes(figures):
    return sorted({figure.plane for figure in figures})


def is_clearly_false(target):
    width, height = target.extent
    return abs(np.log(width / height)) > HARDLY_FALSE


def calibrated(squares, seed):
    """A photograph of squares among ten rectangles, and its calibration or error."""
    rng = np.random.default_rng([61, squares, seed])
    mixed = mixed_scene(rng, squares=squares, rectangles=10)
    picture = photograph(mixed, rng)
    try:
        return mixed, ts.calibrate(picture)
    except ts.TrisquareError as error:
        return mixed, error


def targets_at(mixed, quads):
    """Indices of the targets at the positions of given corners."""
    count = len(mixed.is_square)
    middles = [mixed.scene.image_points(i, np.zeros((1, 2)))[0] for i in range(count)]
    gaps = [np.linalg.norm(np.array(middles) - quad.mean(axis=0), axis=1) for quad in quads]
    return [int(gap.argmin()) for gap in gaps]


@pytest.mark.parametrize("seed", first_quick(range(6), 2))
def test_three_squares_among_ten_rectangles_are_chosen(seed):
    mixed = mixed_scene(np.random.default_rng([62, seed]))
    kept = planes(chosen(edges_of(mixed.scene, NOISE, seed)).figures)
    assert {0, 1, 2} <= set(kept)
    assert not any(is_clearly_false(mixed.scene.targets[plane]) for plane in kept)


def test_squares_that_agree_are_all_kept_without_a_word():
    figures = edges_of(squares(3, count=6), NOISE)
    found = chosen(figures)
    assert found.figures == figures
    assert found.rejected == found.warnings == []


def test_both_outlines_of_a_frame_go_together():
    frames = squares(5, count=4, kind="frame")
    others = mixed_scene(np.random.default_rng(63), squares=0, camera=frames.camera)
    scene = Scene(frames.camera, (*frames.targets, *others.scene.targets))
    figures = edges_of(scene, NOISE)
    kept = chosen(figures).figures
    assert {0, 1, 2, 3} <= set(planes(kept))
    for plane in range(len(scene.targets)):
        count = sum(figure.plane == plane for figure in figures)
        assert sum(figure.plane == plane for figure in kept) in (0, count)


def sheets_of_squares(rng, camera, sheets=6, per_side=5, false_share=0.2):
    """Tilted sheets of squares, some of them stretched, and which squares are true."""
    width, height = camera.image_size
    cell = 0.8 * min(width / 3, height / 2) / per_side
    targets, is_square = [], []
    for sheet in range(sheets):
        place = np.array([(sheet % 3 + 0.5) / 3 * width, (sheet // 3 + 0.5) / 2 * height])
        direction = 2 * np.pi * sheet / sheets + rng.uniform(-0.3, 0.3)
        tilt = np.radians(rng.uniform(25, 50))
        axis = tilt * np.array([np.cos(direction), np.sin(direction), 0.0])
        rotation = cv2.Rodrigues(axis)[0]
        ray = np.append(camera.undistort(place[None])[0], 1.0)
        steps = 1.6 * (np.arange(per_side) - (per_side - 1) / 2)
        for x, y in itertools.product(steps, steps):
            true = rng.random() >= false_share
            stretch = 1.0 if true else np.exp(rng.choice([-1, 1]) * rng.uniform(0.2, 0.5))
            middle = 1.6 * camera.fx / cell * ray + rotation @ [x, y, 0.0]
            printed = rectangle(0.5 * stretch, 0.5 / stretch)
            targets.append(simulate.Target(rotation, middle, printed=printed))
            is_square.append(true)
    return Scene(camera, tuple(targets)), np.array(is_square)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_of_a_hundred_and_fifty_candidates_nearly_all_squares_are_chosen(seed):
    rng = np.random.default_rng([67, seed])
    scene, is_square = sheets_of_squares(rng, simulate.random_camera(rng, (4000, 3000)))
    figures = edges_of(scene, NOISE, seed)
    quads = {figure.plane: np.eye(4, 2) for figure in figures}
    size = scene.camera.image_size
    found = chosen_among(figures, size, quads)
    kept = np.isin(np.arange(len(is_square)), planes(found.figures))
    assert np.mean(kept[is_square]) > 0.95
    # At this distance, some rectangles look like squares with another tilt.
    assert np.mean(kept[~is_square]) < 0.25
    result = ts.calibrate_edges(found.figures, size)
    assert_within(result, scene, SURE)


def test_with_the_focal_length_alone_unknown_two_squares_are_chosen():
    camera = simulate.TrueCamera(1100.0, 1100.0, 639.5, 479.5)
    mixed = mixed_scene(np.random.default_rng(64), squares=2, rectangles=6, camera=camera)
    fixed = ("aspect", "principal_point", "distortion")
    kept = planes(chosen(edges_of(mixed.scene, NOISE), fixed=fixed).figures)
    assert {0, 1} <= set(kept)
    assert not any(is_clearly_false(mixed.scene.targets[plane]) for plane in kept)


def board_edges(rng, camera, plane, waves):
    """The grid lines of a board of 7 x 7 cells, displaced by waves with an amplitude in pixels."""
    rotation = tilted(rng.uniform(20.0, 40.0), rng.uniform(0.0, 360.0), 0.0)
    middle = np.append(rng.uniform(-1.5, 1.5, 2), rng.uniform(13.0, 15.0))
    along = np.linspace(-3.5, 3.5, 60)
    lines, points = [], []
    for offset in np.arange(-3.5, 4.0):
        for line, own in (((0.0, 1.0), (along, offset)), ((1.0, 0.0), (offset, along))):
            x, y = np.broadcast_arrays(*own)
            seen = camera.project(np.stack([x, y, 0 * x], axis=1) @ rotation.T + middle)
            lines.append((*line, -offset))
            waved = waves * np.sqrt(2.0) * np.sin(along + offset)[:, None]
            points.append(seen + waved + rng.normal(0.0, 0.01, seen.shape))
    return ts.PlaneEdges(np.array(lines), points, plane=plane, image=plane)


def test_a_board_that_is_less_flat_is_no_false_one_beside_a_false_square():
    rng = np.random.default_rng(5)
    camera = ts.Camera([[1000.0, 0, 639.5], [0, 1000.0, 479.5], [0, 0, 1]], [0.0] * 5, IMAGE_SIZE)
    boards = [board_edges(rng, camera, plane, 0.06 * (plane == 2)) for plane in range(6)]
    corners = np.array([[100.0, 100.0], [170.0, 110.0], [160.0, 140.0], [95.0, 133.0]])
    shares = np.linspace(0.0, 1.0, 20)[:, None]
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    square = ts.PlaneEdges.square([a + shares * (b - a) for a, b in sides], plane=6, image=0)
    assert planes(chosen([*boards, square]).figures) == [0, 1, 2, 3, 4, 5]


@pytest.mark.slow
def test_pictures_of_one_camera_pool_their_candidates():
    figures, is_square, targets = [], [], []
    rng = np.random.default_rng(65)
    camera = simulate.random_camera(rng, IMAGE_SIZE)
    for image in range(5):
        mixed = mixed_scene(rng, camera=camera)
        own = edges_of(mixed.scene, NOISE, image)
        # Planes are numbered consecutively over the pictures.
        figures += [
            ts.PlaneEdges(
                one.lines,
                one.points,
                plane=one.plane + len(is_square),
                image=image,
                freedom=one.freedom,
            )
            for one in own
        ]
        is_square += mixed.is_square
        targets += mixed.scene.targets
    kept = planes(chosen(figures).figures)
    assert all(plane in kept for plane, square in enumerate(is_square) if square)
    assert not any(is_clearly_false(targets[plane]) for plane in kept)


@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_a_picture_of_squares_and_rectangles_calibrates_and_reports_the_rest(seed):
    mixed, result = calibrated(3, seed)
    assert_within(result, mixed.scene, SURE)
    used = targets_at(mixed, [plane.corners for plane in result.planes])
    assert {0, 1, 2} <= set(used)
    assert not any(is_clearly_false(mixed.scene.targets[target]) for target in used)
    rest = targets_at(mixed, [other.corners for other in result.rejected])
    assert len(rest) == len(set(rest)) >= 5
    assert not set(used) & set(rest)
    assert all(other.residual > 0.0 for other in result.rejected)
    again = ts.Calibration.from_json(result.to_json())
    assert [one.reason for one in again.rejected] == [one.reason for one in result.rejected]


@pytest.mark.slow
@pytest.mark.parametrize("squares", [0, 1, 2])
@pytest.mark.parametrize("seed", range(2))
def test_too_few_squares_are_refused_or_doubted_or_right(squares, seed):
    mixed, result = calibrated(squares, seed)
    if isinstance(result, ts.TrisquareError):
        return
    error = abs(result.camera.K[0, 0] - mixed.scene.camera.fx)
    right = error < max(SURE * result.std["fx"], 0.01 * mixed.scene.camera.fx)
    doubted = any(word in text for text in result.warnings for word in WORDS_OF_DOUBT)
    assert right or doubted
