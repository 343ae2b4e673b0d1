"""The stated uncertainty is true, and violations of its assumptions are detected and named."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from disturbed import (
    SPACING,
    bowed,
    displaced,
    disturbed_edges,
    neighbours_correlated,
    rough,
    white,
)
from quick import first_quick
from scenes import IMAGE_SIZE, assert_exact, assert_within, errors_in_std, squares

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene, rectangle, sample_sides
from trisquare_scenes.damage import RECTANGLE_RATIO, damaged_scene

NOISE = 0.2

# Threshold in standard deviations of a statistic, exceeded by chance once in fifteen thousand runs.
SURE = 4.0

# Half width of a 95 % interval of a normal distribution, in standard deviations.
HALF_WIDTH = 1.959964

WHITE_SCENES = 120
QUIET_SCENES = 40
FEW_SCENES = 30
DISPLACED_SCENES = 15

# Ratio of the noise of a rough plane to that of the others.
ROUGHNESS = 5.0

# Height of a bent side over the noise: more than a robust loss takes for noise.
BOW = 20.0

# Rms of each polynomial of a side's displacement over the noise: an eighth of it would be visible.
DISPLACEMENT = 0.5

# Fraction of its width by which a trapezium is narrower on one side.
TAPER = 0.08


def calibrated(scene, errors, seed, noise=NOISE):
    return ts.calibrate_edges(disturbed_edges(scene, errors, noise, seed), IMAGE_SIZE)


def mean_square(result, scene):
    """The mean square error of the parameters relative to their covariance: 1 on average."""
    in_std = errors_in_std(result, scene)
    error = np.array([in_std[name] * result.std[name] for name in result.parameters])
    return error @ np.linalg.solve(result.covariance, error) / len(error)


def assert_mean_square_is_one(values, parameters=6):
    """`parameters * values` are chi-squared; a std wrong by 1.5 would make it 0.44 or 2.25."""
    deviation = np.sqrt(2.0 / (parameters * len(values)))
    assert np.mean(values) == pytest.approx(1.0, abs=SURE * deviation)


def with_false_target(scene, plane, printed):
    targets = list(scene.targets)
    targets[plane] = replace(targets[plane], printed=printed)
    return Scene(scene.camera, tuple(targets))


def false_shape(name):
    if name == "rectangle":
        stretch = np.sqrt(RECTANGLE_RATIO)
        return rectangle(0.5 * stretch, 0.5 / stretch)
    printed = rectangle(0.5, 0.5)
    printed[:2, 0] *= 1.0 - TAPER
    return printed


@cache
def white_result(seed):
    """A scene under independent noise, and its calibration."""
    scene = squares(seed)
    return scene, calibrated(scene, white, seed)


def white_results(count):
    return [white_result(seed) for seed in range(count)]


@pytest.mark.parametrize("count", first_quick([FEW_SCENES, WHITE_SCENES]))
def test_the_covariance_of_white_noise_is_neither_too_small_nor_too_large(count):
    results = white_results(count)
    assert_mean_square_is_one([mean_square(result, scene) for scene, result in results])


@pytest.mark.slow
def test_the_intervals_hold_the_truth_as_often_as_they_say():
    held = [
        abs(error) < HALF_WIDTH
        for scene, result in white_results(WHITE_SCENES)
        for error in errors_in_std(result, scene).values()
    ]
    # The six errors of a scene are correlated, so they count as one. Two thirds of the std would
    # give 81 %.
    deviation = np.sqrt(0.95 * 0.05 / WHITE_SCENES)
    assert np.mean(held) > 0.95 - SURE * deviation > 0.81


def test_white_noise_gives_no_warning():
    results = white_results(QUIET_SCENES)
    assert [result.warnings for _, result in results] == [()] * QUIET_SCENES


def test_exact_points_give_next_to_no_uncertainty_and_no_warning():
    for seed in range(5):
        scene = squares(seed)
        result = calibrated(scene, white, seed, noise=0.0)
        assert_exact(result.camera, scene)
        assert max(result.std.values()) < 1e-8
        assert result.warnings == ()


@pytest.mark.parametrize("scenes", first_quick([10, FEW_SCENES]))
def test_a_rough_plane_does_not_poison_the_others(scenes):
    """With equal weights, the std would be that for the pooled noise, if correct at all."""
    pooled_noise = NOISE * np.sqrt((ROUGHNESS**2 + 2.0) / 3.0)
    squares_of_errors, parts = [], []
    for seed in range(scenes):
        scene = squares(seed)
        result = calibrated(scene, rough(seed % 3, ROUGHNESS), seed)
        assert_within(result, scene, SURE)
        squares_of_errors.append(mean_square(result, scene))
        pooled = simulate.cramer_rao_bound(scene, pooled_noise, spacing=SPACING)
        parts.append([result.std[name] / pooled[name] for name in result.std])
    assert_mean_square_is_one(squares_of_errors)
    assert np.mean(parts) < 0.8


def test_correlated_neighbours_count_for_less():
    """The variance of a mean is `(1 + c) / (1 - c)` times that with independent samples."""
    correlation = 0.3
    errors = neighbours_correlated(correlation)
    squares_of_errors, factors = [], []
    for seed, (scene, independent) in enumerate(white_results(FEW_SCENES)):
        result = calibrated(scene, errors, seed)
        squares_of_errors.append(mean_square(result, scene))
        factors.append([result.std[name] / independent.std[name] for name in result.std])
    assert_mean_square_is_one(squares_of_errors)
    expected = np.sqrt((1.0 + correlation) / (1.0 - correlation))
    # It is a few per cent less without the lags that may be chance.
    assert np.mean(factors) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize("scenes", first_quick([2, DISPLACED_SCENES]))
def test_sides_that_err_together_raise_the_std_and_are_told(scenes):
    """No model foresees these displacements, so the std may be wrong by a factor of two."""
    squares_of_errors = []
    for seed, (scene, independent) in enumerate(white_results(scenes)):
        result = calibrated(scene, displaced(DISPLACEMENT), seed)
        assert all(result.std[name] > 2.0 * independent.std[name] for name in result.std)
        told = [text for text in result.warnings if "have a common error" in text]
        assert len(told) == 1
        pixels = float(
            re.search(r"have a common error, of (\d+\.\d+) px on plane [012] ", told[0])[1]
        )
        # Four polynomials of that rms.
        assert 0.5 < pixels / (2.0 * DISPLACEMENT * NOISE) < 2.0
        squares_of_errors.append(mean_square(result, scene))
    assert np.mean(squares_of_errors) < 2.0**2


@pytest.mark.parametrize("shape", first_quick(["rectangle", "trapezium"]))
@pytest.mark.parametrize("count", first_quick([4, 5]))
@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_a_false_square_among_four_is_named_and_left_out(shape, count, seed):
    plane = seed % count
    scene = with_false_target(squares(seed, count=count), plane, false_shape(shape))
    result = calibrated(scene, white, seed)
    assert len(result.warnings) == 1
    assert result.warnings[0].startswith(f"plane {plane} was rejected")
    assert_within(result, scene, SURE)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["rectangle", "trapezium"])
def test_a_false_square_of_three_is_told_as_far_as_it_shows(shape):
    """Three planes leave two constraints, which a false square may satisfy by chance."""
    told, seeds = 0, 12
    for seed in range(seeds):
        scene = with_false_target(squares(seed), seed % 3, false_shape(shape))
        try:
            told += bool(calibrated(scene, white, seed).warnings)
        except ts.DegenerateGeometryError:
            told += 1
    assert told >= 0.75 * seeds


@pytest.mark.parametrize("seeds", first_quick([1, 12]))
def test_a_bent_side_is_named_and_left_out(seeds):
    named = 0
    for seed in range(seeds):
        plane, side = seed % 3, seed % 4
        scene = squares(seed)
        result = calibrated(scene, bowed(plane, side, BOW), seed)
        assert_within(result, scene, SURE)
        assert result.warnings
        named += result.warnings[0].startswith(f"plane {plane}: side {side} is rejected")
    # Where the bent side cannot be identified, the std is raised for all.
    assert named >= 5 / 6 * seeds


def test_warnings_survive_json():
    result = calibrated(squares(0), displaced(DISPLACEMENT), 0)
    again = ts.Calibration.from_json(result.to_json())
    assert again.warnings == result.warnings != ()
    assert again.std == result.std


@pytest.mark.parametrize("kind", first_quick(["finger", "curl", "rectangle"], 2))
@pytest.mark.parametrize("index", first_quick([2, 1]))
def test_damage_in_a_picture_is_named_and_does_no_harm(kind, index):
    rng = np.random.default_rng([41, index])
    picture, scene, damage = damaged_scene(rng, kind)
    result = ts.calibrate(picture)
    assert_within(result, scene, SURE)
    centre = scene.image_points(damage.plane, np.zeros((1, 2)))[0]
    middles = np.array([plane.corners.mean(axis=0) for plane in result.planes])
    plane = int(np.linalg.norm(middles - centre, axis=1).argmin())
    about = [text for text in result.warnings if re.search(rf"\bplane {plane}\b", text)]
    assert about
    if damage.side is not None:
        corners = result.planes[plane].corners
        true_side = sample_sides(scene.camera, scene.targets[damage.plane], SPACING)[damage.side]
        sides = 0.5 * (corners + np.roll(corners, -1, axis=0))
        gaps = np.linalg.norm(sides - true_side.image.mean(axis=0), axis=1)
        assert any(re.search(rf"\bside {gaps.argmin()}\b", text) for text in about)


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 3])
def test_a_curled_side_does_not_pass_for_weak_geometry(index):
    """The geometry is sound: without the curl, the std of fx would be 2 px."""
    rng = np.random.default_rng([41, index])
    picture, scene, _ = damaged_scene(rng, "curl")
    result = ts.calibrate(picture)
    assert_within(result, scene, SURE)


@pytest.mark.slow
def test_a_slight_displacement_does_not_pass_for_weak_geometry():
    """The displacement is a quarter of the noise; without it, the std of fy is 3 px of 1535."""
    scene = squares(17)
    assert_within(calibrated(scene, displaced(0.25), 17), scene, 2.0 * SURE)


def test_a_bent_side_that_the_others_cannot_replace_stays_while_its_bend_is_seen():
    """Without it, too little is left; with it, a robust loss may hide the bend from the std."""
    scene, plane, side = squares(1070), 2, 0
    slight = calibrated(scene, bowed(plane, side, 0.25 * BOW), 1070)
    assert_within(slight, scene, SURE)
    assert any("have a common error" in text for text in slight.warnings)
    with pytest.raises(ts.DegenerateGeometryError):
        calibrated(scene, bowed(plane, side, 2.0 * BOW), 1070)


def in_two_pieces(figure, sides):
    """The same edges, with some sides measured in two pieces."""
    lines, points = [], []
    for index, (line, own) in enumerate(zip(figure.lines, figure.points, strict=True)):
        pieces = np.array_split(own, 2) if index in sides else [own]
        lines += [line] * len(pieces)
        points += pieces
    return ts.PlaneEdges(lines, points)


@pytest.mark.parametrize("model", ["radial2", "auto"])
@pytest.mark.parametrize("sides", [(0,), (0, 1, 2, 3)])
def test_a_side_may_be_measured_in_two_pieces(model, sides):
    """Something covers its middle, or the figure has several edges on one line, as a plus has."""
    for seed in range(3):
        scene = squares(seed, count=4)
        edges = disturbed_edges(scene, white, NOISE, seed)
        whole = ts.calibrate_edges(edges, IMAGE_SIZE, model=model)
        parted = [in_two_pieces(figure, sides) for figure in edges]
        result = ts.calibrate_edges(parted, IMAGE_SIZE, model=model)
        assert not any(plane.rejection for plane in result.planes)
        for name in ("fx", "fy", "cx", "cy"):
            change = getattr(result.camera, name) - getattr(whole.camera, name)
            assert abs(change) < 0.3 * whole.std[name]
            assert 0.8 < result.std[name] / whole.std[name] < 1.3


def test_a_few_points_a_side_tell_their_noise_and_the_camera():
    """The fit to 36 points leaves half of their noise, which was taken for all of it."""
    scores, scales = [], []
    for seed in range(60):
        rng = np.random.default_rng([171, seed])
        scene = simulate.random_scene(rng)
        edges = []
        for sides in simulate.edge_points(scene, rng, noise=0.1):
            few = [side[[3, len(side) // 2, -4]] for side in sides]
            edges.append(ts.PlaneEdges.square(few, std=0.1))
        result = ts.calibrate_edges(edges, scene.camera.image_size)
        scales.append(result.noise_scale)
        for name in ("fx", "fy", "cx", "cy"):
            error = getattr(result.camera, name) - getattr(scene.camera, name)
            scores.append(error / result.std[name])
    assert 0.85 < np.median(scales) < 1.1
    assert np.mean(np.abs(scores) > 3) < 0.03
