"""Planes known to be at right angles to each other, or parallel."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import squares

import trisquare as ts
from trisquare.simulate import corner_scene, edge_points, random_camera, random_scene, render

ALL = ((0, 1), (1, 2), (0, 2))
NAMES = ("fx", "fy", "cx", "cy")
NOISE = 0.1

STRETCHED = [(-0.6, -0.5), (0.6, -0.5), (0.6, 0.5), (-0.6, 0.5)]
"""Corners of a false square."""


def corner(seed):
    """Squares on three walls that meet at right angles, and their edges."""
    rng = np.random.default_rng([811, seed])
    scene = corner_scene(rng, camera=random_camera(rng))
    scene = replace(scene, targets=tuple(replace(t, kind="square") for t in scene.targets))
    return scene, edges_of(scene, rng)


def edges_of(scene, rng):
    return [ts.PlaneEdges.square(sides) for sides in edge_points(scene, rng, noise=NOISE)]


def codes(result):
    return [warning.code for warning in result.warnings]


def test_right_angles_are_held_and_tell_of_the_camera_as_the_intervals_say():
    deviations, gain = [], []
    for seed in range(25):
        scene, edges = corner(seed)
        size = scene.camera.image_size
        result = ts.calibrate_edges(edges, size, orthogonal=ALL)
        normals = np.array([plane.rotation[:, 2] for plane in result.planes])
        assert np.abs(normals @ normals.T - np.eye(3)).max() < 1e-9
        assert "relation_contradicted" not in codes(result)
        assert (result.orthogonal, result.parallel) == (ALL, ())
        assert str(ts.plane_angle(*result.planes[:2], result)) == "90 degrees, fixed"
        error = [getattr(result.camera, name) - getattr(scene.camera, name) for name in NAMES]
        deviations += [e / result.std[name] for e, name in zip(error, NAMES, strict=True)]
        gain.append(ts.calibrate_edges(edges, size).std["fx"] / result.std["fx"])
    assert 0.8 < np.sqrt(np.mean(np.square(deviations))) < 1.25
    assert np.median(gain) > 1.2


def test_an_angle_is_held_between_planes_of_another_copy_of_the_result():
    scene, edges = corner(0)
    result = ts.calibrate_edges(edges, scene.camera.image_size, orthogonal=[(1, 0)])
    first, second, third = ts.Calibration.from_json(result.to_json()).planes
    assert ts.plane_angle(first, second, result).std == 0.0
    assert ts.plane_angle(second, first, result).std == 0.0
    assert ts.plane_angle(first, third, result).std > 0.0


def test_parallel_planes_turn_alike_and_the_pose_s_own_covariance_allows_for_it():
    scene = squares(3)
    first, second, *others = scene.targets
    scene = replace(scene, targets=(first, replace(second, rotation=first.rotation), *others))
    errors, stds = [], []
    for seed in range(40):
        edges = edges_of(scene, np.random.default_rng(seed))
        result = ts.calibrate_edges(edges, scene.camera.image_size, parallel=[(0, 1)])
        one, other = (plane.rotation[:, 2] for plane in result.planes[:2])
        assert np.linalg.norm(np.cross(one, other)) < 1e-9
        plane = result.planes[1]
        errors.append(plane.translation - scene.targets[1].translation)
        known = plane.uncertainty
        by_camera = known.by_camera[:, : len(result.parameters)]
        covariance = known.given_camera + by_camera @ result.covariance @ by_camera.T
        stds.append(np.sqrt(np.diag(covariance))[3:])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(stds, axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.35)), ratio


@pytest.mark.parametrize(("count", "false"), [(5, 0), (5, 2), (18, 3)])
def test_they_stay_those_of_the_same_planes_where_a_false_one_is_left_out(count, false):
    scene = squares(count, count=count)
    one, other, targets = count - 2, count - 1, list(scene.targets)
    targets[other] = replace(targets[other], rotation=targets[one].rotation)
    targets[false] = replace(targets[false], printed=STRETCHED)
    scene = replace(scene, targets=tuple(targets))
    edges = edges_of(scene, np.random.default_rng(count))
    result = ts.calibrate_edges(edges, scene.camera.image_size, parallel=[(one, other)])
    assert [w.plane for w in result.warnings if w.code == "plane_rejected"] == [false]
    normals = [result.planes[i].rotation[:, 2] for i in (one, other)]
    assert np.linalg.norm(np.cross(*normals)) < 1e-9
    for name in NAMES:
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < 4 * result.std[name]


def test_planes_that_stand_otherwise_are_no_sign_of_a_fisheye():
    rng = np.random.default_rng(6200)
    scene = random_scene(rng)
    sides = edge_points(scene, rng, noise=0.1)
    edges = [ts.PlaneEdges.square(four) for four in sides]
    result = ts.calibrate_edges(edges, scene.camera.image_size, orthogonal=[(0, 1)])
    assert result.warnings[0].code == "relation_contradicted"
    assert not any("fisheye" in warning for warning in result.warnings)


def test_planes_that_stand_otherwise_are_named():
    scene = squares(6)
    edges = edges_of(scene, np.random.default_rng(0))
    one, other = (target.rotation[:, 2] for target in scene.targets[:2])
    off = np.degrees(np.arcsin(abs(one @ other)))
    result = ts.calibrate_edges(edges, scene.camera.image_size, orthogonal=[(0, 1)])
    warning = result.warnings[0]
    assert (warning.code, warning.severity) == ("relation_contradicted", "high")
    assert "planes 0 and 1" in warning
    assert abs(float(str(warning).split(" are ")[1].split(" ")[0]) - off) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "relations", "text"),
    [
        (3, {"parallel": [(2, 1)]}, r"planes 2 and 1 are .* from parallel"),
        (12, {"orthogonal": [(0, 1)]}, r"planes 0 and 1 are .* from right angles"),
    ],
)
def test_a_refusal_names_planes_that_stand_otherwise(seed, relations, text):
    scene = squares(seed)
    edges = edges_of(scene, np.random.default_rng(0))
    with pytest.raises(ts.DegenerateGeometryError, match=text):
        ts.calibrate_edges(edges, scene.camera.image_size, **relations)


@pytest.mark.parametrize(
    ("relations", "text"),
    [
        ({"orthogonal": [(0, 3)]}, "plane 3 cannot be related"),
        ({"orthogonal": [(0, 1)], "parallel": [(1, 0)]}, "contradict each other"),
        ({"orthogonal": [(1, 1)]}, "pairs of the indices of two planes"),
        ({"parallel": [(0, 1, 2)]}, "pairs of the indices of two planes"),
        ({"parallel": ["01"]}, "pairs of the indices of two planes"),
        ({"parallel": (0, 1)}, "pairs of the indices of two planes"),
        ({"orthogonal": [(0, -1)]}, "pairs of the indices of two planes"),
    ],
)
def test_relations_that_there_cannot_be_are_refused(relations, text):
    scene, edges = corner(0)
    with pytest.raises(ValueError, match=text):
        ts.calibrate_edges(edges, scene.camera.image_size, **relations)


def test_planes_of_two_pictures_have_no_known_angle():
    scene, edges = corner(0)
    edges[2] = ts.PlaneEdges.square(edges[2].points, image=1)
    with pytest.raises(ValueError, match="in another picture"):
        ts.calibrate_edges(edges, scene.camera.image_size, orthogonal=[(0, 2)])


def test_the_fit_to_the_pixels_holds_them_too():
    rng = np.random.default_rng(5)
    scene = corner_scene(rng)
    picture = render(scene, rng, noise=1.0)
    without = ts.calibrate(picture)
    result = ts.calibrate(picture, orthogonal=ALL)
    assert result.stage == "pixels"
    normals = np.array([plane.rotation[:, 2] for plane in result.planes])
    assert np.abs(normals @ normals.T - np.eye(3)).max() < 1e-9
    assert result.std["fx"] < without.std["fx"]
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"]
