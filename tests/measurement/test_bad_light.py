"""Squares with blur, motion, noise, low contrast or bad coding: found, with true stds."""

import numpy as np
import pytest
from quick import first_quick
from scenes import errors_in_std, squares

import trisquare as ts
from trisquare import simulate

STDS = 4.0
SMALL = (960, 720)
"""A size that is not halved for the search: the hardest one for blur and noise."""

CONDITIONS = {
    "defocus": {"blur": 4.0},
    "defocus and noise": {"blur": 4.0, "noise": 8.0, "contrast": 60.0},
    "faint and defocus": {"blur": 4.0, "contrast": 30.0},
    "faint and noise": {"noise": 8.0, "contrast": 30.0},
    "motion": {"motion": simulate.Motion(14.0, 25.0)},
    "motion and noise": {"motion": simulate.Motion(14.0, 100.0), "noise": 8.0},
    "jpeg": {"jpeg_quality": 60, "noise": 4.0, "blur": 2.0},
}


@pytest.mark.parametrize("name", first_quick(CONDITIONS))
def test_squares_in_bad_light_are_found_and_measured(name):
    seed = 7300 + list(CONDITIONS).index(name)
    scene = squares(seed, kind="frame" if seed % 2 else "square", image_size=SMALL)
    settings = {"blur": 0.8, "noise": 2.0, **CONDITIONS[name]}
    picture = simulate.render(scene, np.random.default_rng(seed), tone="srgb", **settings)
    result = ts.calibrate(picture)
    assert len(result.planes) == 3
    errors = errors_in_std(result, scene)
    assert max(abs(error) for error in errors.values()) < STDS, errors
    assert abs(result.camera.fx / scene.camera.fx - 1.0) < 0.03


def edge_errors(picture, scene):
    """Mean outward distance of each side's samples from the true side, in pixels."""
    means = []
    for edges, target in zip(
        ts.detect(picture, tone="srgb"), by_place(picture, scene), strict=True
    ):
        centre = np.concatenate(edges.points).mean(axis=0)
        true_sides = target
        for points in edges.points:
            gaps = [np.abs(offsets(points, side, centre)).mean() for side in true_sides]
            means.append(offsets(points, true_sides[int(np.argmin(gaps))], centre).mean())
    return np.array(means)


def by_place(picture, scene):
    """Dense samples of the targets' true sides, in the order of detection."""
    sides = simulate.edge_points(scene, np.random.default_rng(0), noise=0.0, spacing=0.25)
    centres = [np.concatenate(outline).mean(axis=0) for outline in sides]
    for edges in ts.detect(picture):
        centre = np.concatenate(edges.points).mean(axis=0)
        yield sides[int(np.argmin([np.linalg.norm(c - centre) for c in centres]))]


def offsets(points, side, centre):
    """Distances of points from a densely sampled side, positive away from the centre."""
    gaps = np.linalg.norm(points[:, None] - side[None], axis=2)
    nearest = np.clip(gaps.argmin(axis=1), 1, len(side) - 2)
    along = side[nearest + 1] - side[nearest - 1]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal /= np.linalg.norm(along, axis=1, keepdims=True)
    normal *= np.sign(((side[nearest] - centre) * normal).sum(axis=1))[:, None]
    return ((points - side[nearest]) * normal).sum(axis=1)


@pytest.mark.parametrize("seed", [8, 11])
def test_a_lamp_nearby_passes_for_no_tone_curve(seed):
    """Its light falls to a third over a third of the picture's width."""
    scene = squares(seed)
    picture = simulate.render(scene, np.random.default_rng(seed), tone="linear", noise=0.0)
    height, width = picture.shape
    y, x = np.mgrid[:height, :width] / width
    light = (1.0 + ((x - 0.4) ** 2 + (y - 0.3) ** 2) / 0.35**2) ** -1.5
    coded = 255.0 * (picture / 255.0 * light) ** (1.0 / 2.2)
    noisy = coded + np.random.default_rng(8).normal(0.0, 1.0, coded.shape)
    result = ts.calibrate(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    assert result.stage == "edges"
    assert "pixels_not_used" in {warning.code for warning in result.warnings}
    errors = errors_in_std(result, scene)
    assert max(abs(error) for error in errors.values()) < STDS, errors


def test_a_motion_moves_no_edge():
    # With a normal blur instead of the box, the sides would be 0.01-0.02 px off, all inward.
    scene = squares(7351)
    motion = simulate.Motion(6.0, 30.0)
    rng = np.random.default_rng(1)
    picture = simulate.render(scene, rng, noise=0.5, blur=0.8, tone="srgb", motion=motion)
    errors = edge_errors(picture, scene)
    assert len(errors) == 12
    assert np.abs(errors).max() < 0.006
    assert abs(errors.mean()) < 0.0015


def test_noise_alone_is_no_square_however_faint_one_may_be():
    rng = np.random.default_rng(7400)
    for size in ((240, 320), (720, 960)):
        noise = np.clip(128.0 + 8.0 * rng.standard_normal(size), 0, 255).astype(np.uint8)
        with pytest.raises(ts.DetectionError):
            ts.detect(noise)


@pytest.mark.parametrize(("length", "direction"), [(0.5, 0.0), (5.0, 90.0), (14.0, 33.0)])
def test_motion_spreads_light_evenly_along_its_path(length, direction):
    kernel = simulate.Motion(length, direction).kernel()
    np.testing.assert_allclose(kernel.sum(), 1.0, rtol=1e-12)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-12)
    steps = np.arange(len(kernel)) - len(kernel) // 2
    x, y = np.meshgrid(steps, steps)
    angle = np.deg2rad(direction)
    along, across = x * np.cos(angle) + y * np.sin(angle), x * np.sin(angle) - y * np.cos(angle)
    # Distribution between pixels adds 1/6 on average, up to 1/4 between two rows.
    assert abs((kernel * along**2).sum() - length**2 / 12.0) < 0.25
    assert (kernel * across**2).sum() < 0.25


def test_motion_keeps_the_light_and_refuses_nonsense():
    flat = np.full((20, 30, 1), 0.25)
    np.testing.assert_allclose(simulate.Motion(7.0, 40.0).blurred(flat), flat, rtol=1e-12)
    colour = np.random.default_rng(0).random((20, 30, 3))
    assert simulate.Motion(0.0).blurred(colour) is colour
    assert simulate.Motion(3.0).blurred(colour).shape == colour.shape
    for length, direction in ((-1.0, 0.0), (np.nan, 0.0), (np.inf, 0.0), (3.0, np.nan)):
        with pytest.raises(ValueError, match="motion"):
            simulate.Motion(length, direction)


def test_sides_that_bound_no_figure_are_left_out(monkeypatch):
    def refused(*_):
        raise ValueError("the sides of figure 0 are not in order round it")

    photo = simulate.render(
        simulate.random_scene(np.random.default_rng(3)), np.random.default_rng(0)
    )
    assert len(ts.detect(photo)) == 3
    monkeypatch.setattr("trisquare.measurement.squares.rectangle_lines", refused)
    with pytest.raises(ts.DetectionError):
        ts.detect(photo)
