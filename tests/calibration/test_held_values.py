"""Parameters held without knowledge of their values: the result states their effect."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scenes import IMAGE_SIZE, camera_of, edges_of, parallel_squares, squares

import trisquare as ts
from trisquare import simulate

NOISE = 0.02


def scene_off_centre(seed):
    """Three squares seen by a camera with a usual principal point, and that camera."""
    rng = np.random.default_rng(seed)
    cx, cy = rng.normal([639.5, 479.5], 0.012 * 1280)
    camera = simulate.TrueCamera(1100, 1100, cx, cy, (-0.1, 0.02, 0, 0, 0), IMAGE_SIZE)
    scene = squares(seed, camera)
    return scene, ts.Camera(camera.K, camera.distortion, IMAGE_SIZE)


def warnings_of(code, result):
    return [warning for warning in result.warnings if warning.code == code]


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_one_plane_says_what_a_principal_point_at_the_centre_is_worth(seed):
    scene, truth = scene_off_centre(seed)
    (edges, *others) = edges_of(scene, NOISE, seed)
    held = ts.calibrate_edges([edges], IMAGE_SIZE, fix="principal_point")
    (warning,) = warnings_of("principal_point_assumed", held)
    assert warning.severity == "high"
    said = r"the standard deviation of fx, ([\d.]+) px, .* which adds ([\d.]+) px"
    stated, added = (float(number) for number in re.match(said, warning).groups())
    assert stated == pytest.approx(held.std["fx"], rel=0.05)
    assert added > stated
    assert abs(held.camera.fx - 1100) < 4 * added
    # There is no warning with a known principal point, nor with three planes, which determine it.
    known = ts.calibrate_edges([edges], IMAGE_SIZE, fix="principal_point", initial=truth)
    assert not warnings_of("principal_point_assumed", known)
    assert abs(known.camera.fx - 1100) < 5 * known.std["fx"]
    three = ts.calibrate_edges([edges, *others], IMAGE_SIZE, fix="principal_point")
    assert not warnings_of("principal_point_assumed", three)


@pytest.mark.parametrize("seed", range(8))
def test_parallel_squares_do_not_take_the_distortion_for_a_witness_of_the_centre(seed):
    _, truth = scene_off_centre(seed)
    camera = simulate.TrueCamera(1100, 1100, *truth.K[:2, 2], truth.distortion, IMAGE_SIZE)
    scene = parallel_squares(camera, np.radians([25, -15, 10]))
    held = ts.calibrate_edges(edges_of(scene, NOISE, seed), IMAGE_SIZE, fix="principal_point")
    (warning,) = warnings_of("principal_point_assumed", held)
    added = float(re.search(r"which adds ([\d.]+) px", warning)[1])
    assert abs(held.camera.fx - 1100) < 3.5 * added
    known = ts.calibrate_edges(
        edges_of(scene, NOISE, seed), IMAGE_SIZE, fix="principal_point", initial=truth
    )
    assert not warnings_of("principal_point_assumed", known)


@pytest.mark.parametrize("seed", range(6))
def test_a_distortion_that_is_held_wrongly_is_told(seed):
    scene, truth = scene_off_centre(seed)
    edges = edges_of(scene, NOISE, seed)
    wrong = ts.calibrate_edges(edges, IMAGE_SIZE, fix="distortion")
    (warning,) = warnings_of("lens_beyond_model", wrong)
    assert (
        "the lens model does not fit the lens, or a fixed value (distortion) is wrong: " in warning
    )
    focal = re.search(r'Without fix="distortion" \(model="radial2"\), fx is ([\d.]+)$', warning)[1]
    assert float(focal) == pytest.approx(ts.calibrate_edges(edges, IMAGE_SIZE).camera.fx, rel=1e-3)
    # The standard deviation includes the doubt.
    assert abs(wrong.camera.fx - 1100) < 4 * wrong.std["fx"]
    known = ts.calibrate_edges(edges, IMAGE_SIZE, fix="distortion", initial=truth)
    assert not warnings_of("lens_beyond_model", known)


@pytest.mark.parametrize(("seed", "count"), [(1, 2), (2, 2), (2, 3), (6, 3)])
def test_an_aspect_that_is_held_wrongly_is_named_beside_the_lens(seed, count):
    scene, truth = scene_off_centre(seed)
    camera = simulate.TrueCamera(1100, 1097, *truth.K[:2, 2], truth.distortion, IMAGE_SIZE)
    scene = replace(scene, camera=camera, targets=scene.targets[:count])
    result = ts.calibrate_edges(edges_of(scene, 0.02, 0), IMAGE_SIZE, fix="aspect")
    texts = [*warnings_of("lens_beyond_model", result), *warnings_of("planes_contradict", result)]
    assert texts
    assert all("or a fixed value (aspect) is wrong" in text for text in texts)


@pytest.mark.parametrize("wrong", [None, "focal", "distortion"])
def test_a_wrong_camera_that_is_held_whole_is_contradicted(wrong):
    scene = squares(3)
    held = camera_of(scene)
    if wrong == "focal":
        held = replace(held, K=held.K * [[1.02, 1, 1], [1, 1.02, 1], [1, 1, 1]])
    if wrong == "distortion":
        held = replace(held, distortion=0.9 * held.distortion)
    result = ts.calibrate_edges(
        edges_of(scene, noise=0.1),
        held.image_size,
        model=held.model,
        fix=("focal", "principal_point", "distortion"),
        initial=held,
    )
    assert result.parameters == ()
    if wrong is None:
        assert result.warnings == ()
        return
    (warning,) = result.warnings
    assert (warning.code, warning.severity) == ("planes_contradict", "high")
    assert "or a fixed value (principal point, focal length, distortion) is wrong" in warning
