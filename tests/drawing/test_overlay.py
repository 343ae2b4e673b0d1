"""The overlay: true distances of samples from the model, drawn where they belong."""

from dataclasses import replace

import numpy as np
import pytest

from trisquare import simulate
from trisquare.analysis.residuals import measured_sides
from trisquare.drawing.overlay import RESIDUAL_COLOUR, draw_overlay
from trisquare.edges import PlaneEdges
from trisquare.results.calibration import Calibration, Camera
from trisquare.results.plane import Plane

UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
SQUARES = simulate.random_scene(np.random.default_rng(21))
FRAMES = simulate.random_scene(np.random.default_rng(22), kind="frame")


def residual_pixels(picture):
    """How many pixels have the residuals' colour, but for the smoothing of their borders."""
    return (np.abs(picture.astype(int) - RESIDUAL_COLOUR) < 60).all(axis=2).sum()


def truth_of(scene):
    camera = scene.camera
    planes = [
        Plane("square", 0, scene.image_points(i, UNIT_SQUARE), t.rotation, t.translation, 0.0, 9)
        for i, t in enumerate(scene.targets)
    ]
    return Calibration(
        camera=Camera(camera.K, camera.distortion, camera.image_size),
        std={"fx": 0.1},
        covariance=[[0.01]],
        parameters=["fx"],
        planes=planes,
        rms=0.0,
        noise_scale=1.0,
        warnings=[],
        method="ml",
        tone=None,
        fixed=[],
        stage="edges",
    )


def edges_of(scene, noise=0.0, spacing=4.0):
    """The scene's figures; a frame's two outlines share a plane."""
    sides = simulate.edge_points(scene, np.random.default_rng(23), noise=noise, spacing=spacing)
    return [
        PlaneEdges.square(target_sides[start : start + 4], plane=number)
        for number, target_sides in enumerate(sides)
        for start in range(0, len(target_sides), 4)
    ]


@pytest.mark.parametrize("scene", [SQUARES, FRAMES], ids=["squares", "frames"])
def test_samples_without_noise_lie_on_the_model(scene):
    sides = list(measured_sides(truth_of(scene), edges_of(scene)))
    assert len(sides) == 4 * sum(len(target.outlines()) for target in scene.targets)
    # A chord of one pixel leaves a curve of radius 125 px by 1e-3 px; these are flatter by far.
    assert max(np.abs(side.residuals).max() for side in sides) < 1e-4


def test_a_sample_s_residual_is_its_distance_with_its_sign():
    calibration, figures = truth_of(SQUARES), edges_of(SQUARES)
    exact = list(measured_sides(calibration, figures[:1]))
    offsets = np.random.default_rng(24).normal(scale=0.5, size=(4, 500))
    moved = [
        side.points + offset[: len(side.points), None] * side.normals
        for side, offset in zip(exact, offsets, strict=True)
    ]
    sides = measured_sides(calibration, [replace(figures[0], points=tuple(moved))])
    for side, offset in zip(sides, offsets, strict=True):
        np.testing.assert_allclose(side.residuals, offset[: len(side.points)], atol=1e-3)


def test_figures_that_are_not_in_the_calibration_are_passed_over():
    calibration, figures = truth_of(SQUARES), edges_of(SQUARES)
    without = replace(calibration, planes=calibration.planes[1:])
    assert len(list(measured_sides(without, figures))) == 8
    assert not list(measured_sides(calibration, figures, image=1))


def test_what_is_drawn_lies_at_the_squares():
    photo = simulate.render(SQUARES, np.random.default_rng(25))
    calibration = truth_of(SQUARES)
    plain, full = (draw_overlay(photo, calibration, e) for e in (None, edges_of(SQUARES, 0.05)))
    assert full.dtype == np.uint8
    assert full.shape == (*photo.shape[:2], 3)
    # Smoothed red comes near.
    assert residual_pixels(plain) < 50
    assert residual_pixels(full) > 1000
    changed = (plain != full).any(axis=2)
    for figure in edges_of(SQUARES):
        for x, y in np.rint(np.vstack(figure.points)).astype(int):
            assert changed[y - 1 : y + 2, x - 1 : x + 2].any()


@pytest.mark.parametrize("exaggeration", [50.0, 200.0])
def test_the_exaggeration_lengthens_the_residuals(exaggeration):
    photo = simulate.render(SQUARES, np.random.default_rng(25))
    edges = edges_of(SQUARES, 0.05, spacing=40.0)
    drawn = [
        draw_overlay(photo, truth_of(SQUARES), edges, exaggeration=factor)
        for factor in (exaggeration, 4 * exaggeration)
    ]
    # The rest is the legend, the same in both.
    assert residual_pixels(drawn[1]) > residual_pixels(drawn[0]) + 100


@pytest.mark.parametrize(
    ("dtype", "shape"),
    [
        (np.uint8, (960, 1280)),
        (np.uint16, (960, 1280, 3)),
        (np.float32, (960, 1280)),
        (np.uint8, (40, 60)),
        (np.uint8, (1, 1, 3)),
    ],
)
def test_any_picture_can_be_drawn_on(dtype, shape):
    photo = np.zeros(shape, dtype)
    drawn = draw_overlay(photo, truth_of(SQUARES), edges_of(SQUARES, 0.05))
    assert (drawn.dtype, drawn.shape) == (np.uint8, (*shape[:2], 3))


def test_squares_behind_the_camera_or_far_outside_do_no_harm():
    calibration = truth_of(SQUARES)
    plane = calibration.planes[0]
    odd = (replace(plane, translation=[0, 0, -3]), replace(plane, translation=[1e6, 0, 0.6]))
    drawn = draw_overlay(np.zeros((96, 128), np.uint8), replace(calibration, planes=odd))
    assert drawn.shape == (96, 128, 3)
