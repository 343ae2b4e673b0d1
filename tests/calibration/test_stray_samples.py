"""Wrong samples among good ones: they are left out and reported, and nothing else is rejected."""

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts

NOISE = 0.1


def displaced(edges, places, distance):
    """The edges with samples displaced by `distance` (px) across their sides."""
    sides = [list(figure.points) for figure in edges]
    for figure, side, sample in places:
        points = sides[figure][side].copy()
        along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
        points[sample] += distance * np.array([-along[1], along[0]])
        sides[figure][side] = points
    return [ts.PlaneEdges.square(own) for own in sides]


def removed(edges, places):
    """The edges without some samples."""
    sides = [list(figure.points) for figure in edges]
    for figure, side, sample in sorted(places, reverse=True):
        sides[figure][side] = np.delete(sides[figure][side], sample, axis=0)
    return [ts.PlaneEdges.square(own) for own in sides]


@pytest.mark.parametrize("model", ["radial2", "auto"])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("places", "distance"),
    [
        ([(0, 1, 20)], 10.0),
        ([(0, 0, 0)], 10.0),
        ([(1, 2, 7), (1, 2, 8)], 5.0),
        ([(0, 1, 5), (0, 3, 11), (1, 0, 19), (2, 2, 2), (2, 3, 30)], 3.0),
    ],
)
def test_stray_samples_are_left_out(places, distance, seed, model):
    edges = edges_of(squares(seed), NOISE, seed)
    without = ts.calibrate_edges(removed(edges, places), IMAGE_SIZE, model=model)
    found = ts.calibrate_edges(displaced(edges, places, distance), IMAGE_SIZE, model=model)
    (warning,) = (w for w in found.warnings if w.code == "stray_samples")
    assert warning.severity == "low"
    counted = "1 sample is" if len(places) == 1 else f"{len(places)} samples are"
    assert warning.startswith(f"{counted} not used: ")
    if len(places) == 1:
        ((figure, side, sample),) = places
        assert f"sample {sample} of side {side} of plane {figure} lies" in warning
    others = [w.code for w in found.warnings if w.code != "stray_samples"]
    assert others == [w.code for w in without.warnings]
    assert found.camera.model == without.camera.model
    assert abs(found.camera.fx - without.camera.fx) < 0.02 * without.std["fx"]
    assert found.std["fx"] == pytest.approx(without.std["fx"], rel=0.02)
    assert found.rms == pytest.approx(without.rms, rel=0.001)


def test_a_bent_side_has_no_stray_samples():
    edges = edges_of(squares(1), NOISE)
    lines = [line.copy() for line in edges[0].points]
    places = np.linspace(-1, 1, len(lines[1]))
    lines[1] += np.outer(4.0 * (1 - places**2), [1.0, 1.0])
    found = ts.calibrate_edges([ts.PlaneEdges.square(lines), *edges[1:]], IMAGE_SIZE)
    codes = [warning.code for warning in found.warnings]
    assert "side_rejected" in codes
    assert "stray_samples" not in codes
