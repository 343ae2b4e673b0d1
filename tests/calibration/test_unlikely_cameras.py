"""Results that fit, but are unlike any real camera."""

import re
from dataclasses import replace

import numpy as np
import pytest
from quick import first_quick
from scenes import edges_of, squares

import trisquare as ts
from trisquare.simulate import Scene, Target, edge_points, fisheye, tilted
from trisquare.simulate.scene import rectangle

SCENE = squares(3)
WIDTH, HEIGHT = SCENE.camera.image_size


def moved(edges, scale=(1.0, 1.0), shift=(0.0, 0.0)):
    """The edges in a picture that was stretched or cropped."""
    return [
        ts.PlaneEdges.square([points * scale + shift for points in figure.points])
        for figure in edges
    ]


def codes(result):
    return [warning.code for warning in result.warnings]


@pytest.mark.parametrize("stretch", first_quick([1.02, 0.97]))
def test_a_stretched_picture_is_named_with_the_answer_for_square_pixels(stretch):
    edges = moved(edges_of(SCENE, noise=0.05), scale=(1.0, stretch))
    result = ts.calibrate_edges(edges, (WIDTH, round(HEIGHT * stretch)))
    assert result.warnings[0].code == "pixels_not_square"
    assert result.warnings[0].severity == "high"
    held = ts.calibrate_edges(edges, (WIDTH, round(HEIGHT * stretch)), fix="aspect")
    assert f'With fix="aspect", fx is {held.camera.fx:.1f}' in result.warnings[0]
    assert "pixels_not_square" not in codes(held)


def test_two_squares_say_what_a_stretched_print_makes_of_them():
    """With either one stretched by 0.3 %, the camera changes by as much as the warning says."""
    found = {}
    for stretched in (None, 0, 1):
        targets = [
            replace(target, printed=rectangle(0.5 * 1.003, 0.5) if i == stretched else None)
            for i, target in enumerate(SCENE.targets[:2])
        ]
        scene = replace(SCENE, targets=tuple(targets))
        # With less noise, a part of the stretch would be estimated.
        found[stretched] = ts.calibrate_edges(edges_of(scene, noise=0.02), (WIDTH, HEIGHT))
    (named,) = [w for w in found[None].warnings if w.code == "targets_unchecked"]
    assert named.severity == "medium"
    moved = [found[i].camera.fx - found[None].camera.fx for i in (0, 1)]
    stated = re.search(r"fx is wrong by ([\d.]+) px", named)
    assert stated is not None
    assert float(stated[1]) == pytest.approx(np.hypot(*moved), rel=0.1)


def standing_like(target, other):
    """The target with another one's orientation, at its own position."""
    return replace(target, rotation=other.rotation)


@pytest.mark.parametrize("degrees", [0, 90, 45])
def test_a_square_that_stands_as_another_does_checks_nothing(degrees):
    first, second, third = SCENE.targets
    turned = replace(first, rotation=first.rotation @ tilted(0, 0, degrees))
    targets = (first, second, standing_like(third, turned))
    scene = replace(SCENE, targets=targets)
    found = ts.calibrate_edges(edges_of(scene, noise=0.05), (WIDTH, HEIGHT))
    warned = [w for w in found.warnings if w.code == "targets_unchecked"]
    # Sides in other directions reveal a stretch that is common to both.
    assert bool(warned) == (degrees != 45)
    for warning in warned:
        assert (
            "3 planes in 2 directions give no more equations than this camera has unknowns"
            in warning
        )


def test_a_third_square_that_is_known_too_roughly_checks_nothing():
    edges = edges_of(SCENE, noise=0.05)
    rng = np.random.default_rng(0)
    rough = [side[::20] + rng.normal(0.0, 2.0, side[::20].shape) for side in edges[2].points]
    found = ts.calibrate_edges([*edges[:2], ts.PlaneEdges.square(rough)], (WIDTH, HEIGHT))
    (told,) = (warning for warning in found.warnings if warning.code == "targets_unchecked")
    said = "2 planes give no more equations than this camera has unknowns (one more is too small"
    assert said in told


def test_the_same_figure_once_more_checks_nothing():
    edges = edges_of(SCENE, noise=0.05)[:2]
    again = edges_of(SCENE, noise=0.05, seed=1)[0]
    found = ts.calibrate_edges([*edges, again], (WIDTH, HEIGHT))
    assert "targets_unchecked" in codes(found)


def test_the_same_measurement_once_more_is_refused():
    edges = edges_of(SCENE, noise=0.05)
    with pytest.raises(ValueError, match="figure 3 has the samples of figure 1: give each"):
        ts.calibrate_edges([*edges, edges[1]], (WIDTH, HEIGHT))


@pytest.mark.parametrize("held", ["aspect", "principal_point"])
def test_what_is_held_checks_two_squares(held):
    edges = edges_of(SCENE, noise=0.05)
    assert "targets_unchecked" not in codes(ts.calibrate_edges(edges, (WIDTH, HEIGHT)))
    two = ts.calibrate_edges(edges[:2], (WIDTH, HEIGHT), fix=held)
    assert "targets_unchecked" not in codes(two)


def test_a_cropped_picture_is_named():
    cut = 200
    edges = moved(edges_of(SCENE, noise=0.05), shift=(-cut, 0.0))
    result = ts.calibrate_edges(edges, (WIDTH - cut, HEIGHT))
    assert {"principal_point_off_centre", "samples_outside_picture"} <= set(codes(result))


def test_what_the_data_leave_open_is_no_reason_to_warn():
    for seed in range(6):
        edges = edges_of(squares(700 + seed), noise=1.0)
        result = ts.calibrate_edges(edges, (WIDTH, HEIGHT))
        assert not {"pixels_not_square", "principal_point_off_centre"} & set(codes(result))


def test_a_lens_whose_polynomial_turns_back_within_the_picture_is_named():
    distortion = np.array([-0.55, 0.0, 0.0, 0.0, 0.0])
    scene = replace(SCENE, camera=replace(SCENE.camera, distortion=distortion))
    result = ts.calibrate_edges(edges_of(scene, noise=0.02), (WIDTH, HEIGHT))
    (named,) = [w for w in result.warnings if w.code == "lens_ends_in_picture"]
    assert named.severity == "medium"
    whole = ts.calibrate_edges(edges_of(SCENE, noise=0.02), (WIDTH, HEIGHT))
    assert "lens_ends_in_picture" not in codes(whole)


@pytest.mark.slow
def test_a_camera_that_errors_of_the_planes_leave_open_is_named():
    """The geometry is sound, but the sides of the squares are bent by more than their noise."""
    rng = np.random.default_rng(17)
    bent = []
    for figure in edges_of(SCENE, noise=0.05):
        sides = []
        for points in figure.points:
            along = points[-1] - points[0]
            normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            place = np.linspace(-1.0, 1.0, len(points))
            bow = rng.normal(0.0, 6.0, 2) @ [1.0 - place**2, place**3 - place]
            sides.append(points + bow[:, None] * normal)
        bent.append(ts.PlaneEdges.square(sides))
    result = ts.calibrate_edges(bent, (WIDTH, HEIGHT))
    assert "barely_determined" in codes(result)
    assert max(result.std["fx"] / result.camera.fx, result.std["cx"] / WIDTH) > 0.04


def test_a_lens_that_is_a_guess_in_most_of_the_picture_is_named():
    """Exact squares in the middle of a fisheye's picture: the camera is right where they are."""
    lens = fisheye(150)
    rng = np.random.default_rng(41)
    targets = [
        Target(tilted(35, 120 * k, 10), np.array([0.84 * x, 0.84 * y, 3.9]))
        for k, (x, y) in enumerate([(1.0, 0.0), (-0.5, 0.87), (-0.5, -0.87)])
    ]
    scene = Scene(lens, tuple(targets))
    edges = [ts.PlaneEdges.square(sides) for sides in edge_points(scene, rng, noise=0.02)]
    for model in ("radial2", "fisheye"):
        result = ts.calibrate_edges(edges, lens.image_size, model=model)
        (named,) = [w for w in result.warnings if w.code == "lens_extrapolated"]
        assert named.severity == "medium"
    whole = ts.calibrate_edges(edges_of(SCENE, noise=0.02), (WIDTH, HEIGHT))
    assert "lens_extrapolated" not in codes(whole)
