"""The overlay: true distances of samples from the model, drawn in the right places."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.residuals import measured_sides
from trisquare.drawing.overlay import RESIDUAL_COLOUR, draw_overlay
from trisquare.drawing.straight_lines import REJECTED, USED
from trisquare.edges import PlaneEdges

SQUARES = simulate.random_scene(np.random.default_rng(21))
FRAMES = simulate.random_scene(np.random.default_rng(22), kind="frame")


def residual_pixels(picture):
    """The number of pixels with the residuals' colour, without their antialiased borders."""
    return (np.abs(picture.astype(int) - RESIDUAL_COLOUR) < 60).all(axis=2).sum()


def calibrated(scene, noise=0.0, spacing=4.0):
    return ts.calibrate_edges(edges_of(scene, noise, spacing), scene.camera.image_size)


def of_pictures(photo, calibration):
    """The same calibration, with the size of a photograph's picture."""
    camera = replace(calibration.camera, image_size=photo.shape[1::-1])
    return replace(calibration, camera=camera)


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
    sides = list(measured_sides(calibrated(scene)))
    assert len(sides) == 4 * sum(len(target.outlines()) for target in scene.targets)
    assert max(np.abs(side.residuals).max() for side in sides) < 1e-6


def test_a_residual_leads_from_the_model_to_its_sample():
    result = calibrated(SQUARES, noise=0.5)
    sides = list(measured_sides(result))
    every = np.concatenate([side.residuals for side in sides])
    assert np.sqrt(np.mean(every**2)) == pytest.approx(result.rms, rel=1e-9)
    lines = [line for figure in result.edges for line in figure.lines]
    for side, line in zip(sides, lines, strict=True):
        np.testing.assert_allclose(np.linalg.norm(side.normals, axis=1), 1.0)
        feet = side.points - side.residuals[:, None] * side.normals
        plane = result.planes[side.plane]
        normal, rays = plane.rotation[:, 2], result.camera.unproject(feet)
        depths = (normal @ plane.translation) / (rays @ normal)
        x, y, _ = plane.rotation.T @ (rays * depths[:, None] - plane.translation).T
        # With sides of some 350 px: a hundredth of a pixel, where the samples are half a pixel off.
        np.testing.assert_allclose(line[0] * x + line[1] * y + line[2], 0.0, atol=3e-5)


def test_a_side_is_drawn_in_order_along_it():
    for side in measured_sides(calibrated(SQUARES, noise=0.5)):
        steps = np.diff(side.curve, axis=0)
        chord = side.curve[-1] - side.curve[0]
        assert (steps @ chord >= 0).all()


def test_another_picture_has_no_sides():
    assert not list(measured_sides(calibrated(SQUARES), image=1))


def test_what_is_drawn_lies_at_the_squares():
    photo = simulate.render(SQUARES, np.random.default_rng(25))
    calibration = calibrated(SQUARES, 0.05)
    without = replace(calibration, edges=(), residuals=())
    plain, full = (draw_overlay(photo, result) for result in (without, calibration))
    assert full.dtype == np.uint8
    assert full.shape == (*photo.shape[:2], 3)
    # Antialiased red is similar.
    assert residual_pixels(plain) < 50
    assert residual_pixels(full) > 1000
    changed = (plain != full).any(axis=2)
    for figure in edges_of(SQUARES):
        for x, y in np.rint(np.vstack(figure.points)).astype(int):
            assert changed[y - 1 : y + 2, x - 1 : x + 2].any()


def test_a_picture_of_another_size_is_refused():
    with pytest.raises(
        ValueError,
        match="the picture has 640 x 480 pixels, but the camera's pictures have 1280 x 960",
    ):
        ts.draw_overlay(np.zeros((480, 640), np.uint8), calibrated(SQUARES, 0.05))


def test_a_file_is_drawn_on_as_its_pixels_are(tmp_path):
    photo, result = simulate.render(SQUARES, np.random.default_rng(3)), calibrated(SQUARES, 0.05)
    cv2.imwrite(str(tmp_path / "photo.png"), photo)
    assert (ts.draw_overlay(tmp_path / "photo.png", result) == draw_overlay(photo, result)).all()


@pytest.mark.parametrize("index", [-1, 1])
def test_a_picture_that_a_result_has_not_is_refused(index):
    result = calibrated(SQUARES, 0.05)
    with pytest.raises(ValueError, match="index must be from 0 to 0"):
        draw_overlay(np.zeros((960, 1280), np.uint8), result, index=index)


@pytest.mark.parametrize(
    ("option", "error"),
    [
        ({"index": 0.5}, TypeError),
        ({"index": "0"}, TypeError),
        ({"exaggeration": np.nan}, ValueError),
    ],
)
def test_numbers_that_are_none_are_refused(option, error):
    with pytest.raises(error, match=f"^{next(iter(option))} (must be|contains NaN)"):
        draw_overlay(np.zeros((960, 1280), np.uint8), calibrated(SQUARES, 0.05), **option)


@pytest.mark.parametrize("exaggeration", [50.0, 200.0])
def test_the_exaggeration_lengthens_the_residuals(exaggeration):
    photo = simulate.render(SQUARES, np.random.default_rng(25))
    calibration = calibrated(SQUARES, 0.05, spacing=40.0)
    drawn = [
        draw_overlay(photo, calibration, exaggeration=factor)
        for factor in (exaggeration, 4 * exaggeration)
    ]
    # The other pixels are the legend, which is the same in both.
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
    drawn = draw_overlay(photo, of_pictures(photo, calibrated(SQUARES, 0.05)))
    assert (drawn.dtype, drawn.shape) == (np.uint8, (*shape[:2], 3))


def test_squares_behind_the_camera_or_far_outside_do_no_harm():
    calibration = replace(calibrated(SQUARES), edges=(), residuals=())
    plane = calibration.planes[0]
    odd = (replace(plane, translation=[0, 0, -3]), replace(plane, translation=[1e6, 0, 0.6]))
    photo = np.zeros((96, 128), np.uint8)
    drawn = draw_overlay(photo, of_pictures(photo, replace(calibration, planes=odd)))
    assert drawn.shape == (96, 128, 3)


def test_used_and_rejected_lines_of_the_scene_are_drawn_apart():
    result = calibrated(SQUARES)
    across = np.linspace([100.0, 900.0], [1100.0, 900.0], 50)
    lines = (
        ts.SceneLine(0, across),
        ts.SceneLine(0, across + np.array([0.0, 40.0]), rejection="it is curved"),
        ts.SceneLine(1, across - np.array([0.0, 800.0])),
    )
    drawn = draw_overlay(np.zeros((960, 1280), np.uint8), replace(result, lines=lines)).astype(int)
    for row, colour in ((900, USED), (940, REJECTED)):
        assert np.abs(drawn[row, 600] - colour).max() < 60
    assert np.abs(drawn[100, 600] - USED).max() > 60
