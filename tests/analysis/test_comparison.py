"""Comparison of two cameras: against known differences, and against repeated measurements."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare.cli.input_files import rescaled
from trisquare.drawing.difference_map import LONGEST_SIDE, draw_comparison

UNSEEN = "it cannot be decided whether the cameras differ: "


@pytest.fixture(scope="module")
def result():
    return ts.calibrate_edges(edges_of(squares(5), noise=0.05, seed=1), IMAGE_SIZE)


def test_a_camera_is_the_same_as_itself(result):
    comparison = ts.compare(result, result)
    assert comparison.same
    assert comparison.worst < 1e-9
    assert comparison.angle < 1e-9
    assert comparison.coverage == 1


def test_a_turn_of_a_wide_pinhole_is_no_difference_but_a_scale_is():
    pinhole = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), IMAGE_SIZE)
    longer = ts.Camera([[909, 0, 639.5], [0, 909, 479.5], [0, 0, 1]], np.zeros(5), IMAGE_SIZE)
    comparison = ts.compare(pinhole, longer)
    # One per cent of the distance from the centre, which no rotation reduces.
    expected = 0.01 * (np.stack(np.meshgrid(comparison.x, comparison.y), axis=-1) - [639.5, 479.5])
    assert np.allclose(comparison.difference, expected, atol=1e-9)
    assert comparison.angle < 1e-9
    assert comparison.same is None
    assert comparison.p_value is None
    assert "neither" in comparison.verdict


def test_the_rotation_takes_up_a_shift_of_the_principal_point():
    K = np.array([[20000, 0, 639.5], [0, 20000, 479.5], [0, 0, 1.0]])
    shifted = K + np.array([[0, 0, 7], [0, 0, -3], [0, 0, 0]])
    comparison = ts.compare(
        ts.Camera(K, np.zeros(5), IMAGE_SIZE), ts.Camera(shifted, np.zeros(5), IMAGE_SIZE)
    )
    # The rotation of a telephoto lens leaves an error of second order in the angles: 7 px * 0.04^2.
    assert comparison.worst < 0.02
    assert np.isclose(np.radians(comparison.angle), np.hypot(7, 3) / 20000, rtol=1e-3)


def test_the_rotation_is_the_best_one(result):
    other = replace(
        result.camera, distortion=result.camera.distortion + np.array([0.02, 0, 0.003, 0, 0])
    )
    comparison = ts.compare(result.camera, other)
    pixels = np.stack(np.meshgrid(comparison.x, comparison.y), axis=-1).reshape(-1, 2)
    rays = result.camera.unproject(pixels) @ comparison.rotation.T
    for turn in 1e-4 * np.concatenate([np.eye(3), -np.eye(3)]):
        turned = rays + np.cross(turn, rays)
        rms = np.sqrt(2 * np.mean((other.project(turned) - pixels) ** 2))
        assert rms > comparison.rms


@pytest.mark.slow
def test_calibrations_of_one_camera_are_the_same_in_95_of_100():
    """At the 5 % level, 3 of 60 pairs should differ; 8 or more occur once in a hundred times."""
    scene, draws = squares(8), 60
    comparisons = []
    for seed in range(draws):
        first, second = (
            ts.calibrate_edges(edges_of(scene, 0.2, 2 * seed + i, spacing=8.0), IMAGE_SIZE)
            for i in range(2)
        )
        comparisons.append(ts.compare(first, second))
    assert sum(not comparison.same for comparison in comparisons) < 8
    found = np.sqrt(np.mean([comparison.rms**2 for comparison in comparisons]))
    expected = np.sqrt(np.mean([comparison.expected_rms**2 for comparison in comparisons]))
    # There are about four free directions of difference: 60 draws determine their rms to 5 %.
    assert found == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("change", [{"fx": 1.02, "fy": 1.02}, {"fy": 1.01}])
def test_cameras_that_differ_are_told_apart(change):
    scene = squares(5)
    camera = scene.camera
    changed = {name: factor * getattr(camera, name) for name, factor in change.items()}
    other = squares(5, camera=replace(camera, **changed))
    results = [
        ts.calibrate_edges(edges_of(some, noise=0.05, seed=seed), IMAGE_SIZE)
        for seed, some in enumerate((scene, other))
    ]
    comparison = ts.compare(*results)
    assert comparison.same is False
    assert comparison.p_value < 1e-3
    assert "differ" in comparison.verdict


def test_a_difference_that_no_parameter_makes_is_no_noise(result):
    """Tangential coefficients are not among the model's parameters, nor in their chi-squared."""
    expected = ts.compare(result, result.camera).expected_rms
    decentred = result.camera.distortion + np.array([0, 0, 0.01, 0.01, 0])
    other = ts.Camera(result.camera.K, decentred, IMAGE_SIZE, "brown")
    comparison = ts.compare(result, other)
    assert comparison.unexplained > expected
    assert comparison.same is False
    assert "px (rms) remain that no uncertain parameter explains" in comparison.verdict


def test_a_difference_in_well_known_ways_is_said_to_be_one(result):
    """A vague k1 makes every position uncertain, but not the shape of the effect of k2."""
    stds = {"fx": 0.1, "fy": 0.1, "cx": 0.1, "cy": 0.1, "k1": 0.02, "k2": 0.001}
    covariance = np.diag([stds[name] ** 2 for name in result.parameters])
    vague = replace(result, covariance=covariance)
    distortion = result.camera.distortion + np.array([0, 0.03, 0, 0, 0])
    comparison = ts.compare(vague, replace(result.camera, distortion=distortion))
    assert comparison.worst_in_stds < 2
    assert comparison.same is False
    assert "known more precisely than the difference at any one place" in comparison.verdict


def test_cameras_without_a_visible_difference_are_the_same(result):
    """However small the stated uncertainty is: files and computers round."""
    certain = replace(result, covariance=np.zeros_like(result.covariance))
    assert ts.compare(certain, certain).same is True
    rounded = replace(result.camera, K=np.round(result.camera.K, 8))
    assert ts.compare(certain, rounded).same is True
    other = replace(result.camera, K=result.camera.K + np.diag([1e-3, 0, 0]))
    assert ts.compare(certain, other).same is False


def test_cameras_that_are_hardly_known_are_not_told_to_be_the_same(run, result, tmp_path):
    """The expected rms is proportional to the standard deviations; the limit is 1 % of 1280 px."""
    other = replace(result.camera, K=result.camera.K + np.diag([1e-3, 0, 0]))
    expected = ts.compare(result, other).expected_rms
    for rms, same in ((12.7, True), (12.9, None), (5000.0, None)):
        scale = rms / expected
        std = {name: scale * own for name, own in result.std.items()}
        vague = replace(result, std=std, covariance=scale**2 * result.covariance)
        comparison = ts.compare(vague, other)
        assert comparison.expected_rms == pytest.approx(rms, rel=1e-6)
        assert comparison.same is same
        assert comparison.verdict.startswith("the same" if same else UNSEEN)
        # A difference is reported however vague the rest is: p excludes noise as its cause.
        assert replace(comparison, p_value=0.01).same is False
        verdict = replace(comparison, p_value=0.01).verdict
        assert verdict.startswith("they differ by more than their stated uncertainty: ")
    equal = ts.compare(vague, vague)
    assert (equal.worst, equal.same) == (pytest.approx(0, abs=1e-6), None)
    assert equal.verdict.startswith(UNSEEN)
    vague.save(tmp_path / "vague.json")
    other.save(tmp_path / "other.json")
    code, printed, _ = run("compare", tmp_path / "vague.json", tmp_path / "other.json")
    assert code == 0
    assert printed.startswith(UNSEEN)
    assert "5000 px (rms) is expected" in printed
    code, printed, _ = run("compare", tmp_path / "vague.json", tmp_path / "other.json", "--json")
    assert json.loads(printed)["same"] is None


def test_what_is_the_same_is_said_with_its_p(result):
    other = replace(result.camera, K=result.camera.K + np.diag([1e-3, 0, 0]))
    comparison = ts.compare(result, other)
    assert comparison.verdict.endswith(f"px (rms) is expected, p = {comparison.p_value:.2g}")


def test_a_difference_beyond_the_targets_is_said_to_be_there(run, result, tmp_path):
    corners = np.concatenate([plane.corners for plane in result.planes])
    assert (corners > 0).all()
    assert (corners < np.array(IMAGE_SIZE) - 1).all()
    longer = replace(result, camera=replace(result.camera, K=result.camera.K * [[1.01], [1], [1]]))
    outer = ts.compare(result, longer)
    assert outer.same is False
    assert outer.worst_at[0] in (0, IMAGE_SIZE[0] - 1)
    assert outer.worst_beyond_targets is True
    x, y = outer.worst_at
    assert f"at ({x:.0f}, {y:.0f}), which lies beyond the targets (among them " in outer.verdict
    assert outer.rms_among_targets < outer.rms
    assert outer.expected_rms_among_targets < outer.expected_rms
    # A frame around the whole picture leaves nothing to extrapolate.
    frame = np.array([[-1, -1], [1280, -1], [1280, 960], [-1, 960]])
    framed = [
        replace(own, planes=tuple(replace(plane, corners=frame) for plane in own.planes))
        for own in (result, longer)
    ]
    assert ts.compare(*framed).worst_beyond_targets is False
    assert ts.compare(*framed).rms_among_targets == ts.compare(*framed).rms
    assert "beyond the targets" not in ts.compare(*framed).verdict
    # The targets of the other result do not reach there.
    assert ts.compare(framed[0], longer).worst_beyond_targets is True
    exact = ts.compare(result.camera, longer.camera)
    assert (exact.worst_beyond_targets, exact.rms_among_targets) == (None, None)
    result.save(tmp_path / "a.json")
    longer.save(tmp_path / "b.json")
    code, out, _ = run("compare", tmp_path / "a.json", tmp_path / "b.json")
    assert code == 0
    assert "\np assumes photographs of their own for each camera, and flat targets: on" in out
    assert "p assumes" not in run("compare", tmp_path / "a.json", tmp_path / "a.json")[1]
    _, out, _ = run("compare", tmp_path / "a.json", tmp_path / "b.json", "--json")
    assert json.loads(out)["worst_beyond_targets"] is True


def test_comparisons_are_read_only_also_after_pickling(result):
    for comparison in (
        found := ts.compare(result, result.camera),
        pickle.loads(pickle.dumps(found)),
    ):
        assert comparison.verdict == found.verdict
        for name in ("rotation", "x", "y", "difference", "std"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(comparison, name)[0] = 0


def test_long_lenses_are_compared_up_to_their_valid_radius():
    K = np.array([[1e6, 0, 639.5], [0, 1e6, 479.5], [0, 0, 1]])
    whole = ts.Camera(K, np.zeros(5), IMAGE_SIZE)
    part = ts.Camera(
        K * [[1.01, 1, 1], [1, 1, 1], [1, 1, 1]], np.zeros(5), IMAGE_SIZE, "none", 5e-4
    )
    comparison = ts.compare(whole, part)
    assert 0.4 < comparison.coverage < 0.7
    assert comparison.worst < 0.01 * 640


def test_beyond_what_a_lens_can_follow_nothing_is_said(result):
    K = result.camera.K
    short = ts.Camera(K, np.zeros(5), IMAGE_SIZE, valid_radius=400 / K[0, 0])
    comparison = ts.compare(ts.Camera(K, np.zeros(5), IMAGE_SIZE), short)
    assert 0.2 < comparison.coverage < 0.6
    assert np.isinf(comparison.distance[0, 0])
    assert np.isfinite(comparison.rms)
    with pytest.raises(ValueError, match="both distortions can be inverted in only"):
        ts.compare(short, replace(short, valid_radius=20 / K[0, 0]))


def test_bad_arguments_are_refused(result):
    with pytest.raises(TypeError, match="second must be"):
        ts.compare(result, "camera.json")
    smaller = ts.Camera(result.camera.K, np.zeros(5), (640, 480))
    with pytest.raises(ValueError, match="640 x 480"):
        ts.compare(result, smaller)


def test_the_map_is_coloured_where_the_cameras_differ(result):
    K = result.camera.K * [[1.01, 1, 1], [1, 1.01, 1], [1, 1, 1]]
    canvas = draw_comparison(ts.compare(result, replace(result.camera, K=K)))
    height = round(LONGEST_SIDE * IMAGE_SIZE[1] / IMAGE_SIZE[0])
    assert canvas.shape[0] > height
    # From violet, with similar blue and red, in the middle to yellow, without blue, in the corner.
    middle, corner = canvas[height // 2, LONGEST_SIDE // 2 + 20], canvas[5, 5]
    assert int(middle[0]) > int(middle[1])
    assert int(corner[1]) > int(corner[0])


def test_command_says_it_in_words_in_json_and_in_a_picture(run, result, tmp_path):
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    first.write_text(result.to_json())
    other = ts.calibrate_edges(edges_of(squares(5), noise=0.05, seed=2), IMAGE_SIZE)
    second.write_text(other.to_json())
    code, printed, _ = run("compare", first, second, "--map", tmp_path / "map.png")
    assert code == 0
    assert "the same within their uncertainty" in printed
    assert (tmp_path / "map.png").stat().st_size > 1000
    members = json.loads(run("compare", first, second, "--json")[1])
    assert members["format"] == "trisquare-comparison/1"
    assert members["same"] is True
    assert members["rms_px"] == pytest.approx(ts.compare(result, other).rms)
    assert members == json.loads(ts.compare(result, other).to_json())


def test_command_refuses_what_is_no_camera(run, result, tmp_path):
    camera, other = tmp_path / "a.json", tmp_path / "b.json"
    camera.write_text(result.to_json())
    other.write_text("{}")
    code, printed, said = run("compare", camera, other, "--map", tmp_path / "map.png")
    assert (code, printed) == (2, "")
    assert "b.json" in said
    assert not (tmp_path / "map.png").exists()


def test_a_camera_of_another_resolution_is_compared_on_request(run, result, tmp_path):
    whole, halved = tmp_path / "a.json", tmp_path / "half.yaml"
    whole.write_text(result.to_json())
    result.camera.rescaled((640, 480)).save(halved)
    code, _, said = run("compare", whole, halved)
    assert code == 2
    sizes = "the camera's pictures are 640 x 480, not 1280 x 960: use --rescale"
    assert f"{halved}, compared with {whole}: {sizes}" in said
    code, printed, _ = run("compare", whole, halved, "--rescale")
    assert code == 0
    assert "the same" in printed


def test_a_rescaled_calibration_keeps_its_uncertainty_in_the_new_pixels(result):
    half = rescaled(result, (640, 480))
    points = np.array([[100.0, 50.0], [300.0, 240.0]])
    std = result.projection_std((points + 0.5) * 2 - 0.5)
    assert np.allclose(half.projection_std(points), std / 2, rtol=1e-9)
