"""Models with more coefficients than the default: never worse than the poorer, never absurd."""

from functools import cache

import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import TrueCamera

RICHER = ("radial3", "brown")


def wide_edges(seed, count=3):
    """Edges as seen by a wide lens outside all models."""
    rng = np.random.default_rng(seed)
    focal, centre = rng.uniform(0.35, 0.5) * IMAGE_SIZE[0], np.array([639.5, 479.5])
    camera = TrueCamera(focal, focal, *centre, np.zeros(5), IMAGE_SIZE)
    bend = rng.uniform(0.5, 0.85)

    def seen(points):
        offset = (points - centre) / focal
        ideal = np.linalg.norm(offset, axis=1, keepdims=True)
        bent = offset * np.tan(bend * np.arctan(ideal)) / bend / ideal * focal + centre
        return bent + rng.normal(0.0, 0.2, points.shape)

    scene = simulate.random_scene(rng, camera=camera, count=count)
    points = simulate.edge_points(scene, rng, noise=0.0, spacing=4.0)
    return [ts.PlaneEdges.square([seen(side) for side in sides]) for sides in points]


@cache
def answer(seed, model, count=3):
    try:
        return ts.calibrate_edges(wide_edges(seed, count), IMAGE_SIZE, model=model)
    except ts.TrisquareError as error:
        return error


def cost(result, scale):
    distances = np.concatenate([own for figure in result.residuals for own in figure.distances])
    return (1.0 - (1.0 - np.minimum(np.abs(distances) / scale / 7.041, 1.0) ** 2) ** 3).sum()


@pytest.mark.parametrize("model", RICHER)
@pytest.mark.parametrize("seed", first_quick([26, 3, 11]))
def test_a_richer_model_fits_no_worse_and_does_not_turn_back_inside_the_picture(seed, model):
    poorer, richer = answer(seed, "radial2"), answer(seed, model)
    scale = poorer.noise_scale
    assert cost(richer, scale) <= cost(poorer, scale) * (1.0 + 1e-6)
    camera = richer.camera
    width, height = IMAGE_SIZE
    corners = [(0.0, 0.0), (width - 1, 0.0), (0.0, height - 1), (width - 1, height - 1)]
    farthest = max(np.hypot(x - camera.cx, y - camera.cy) for x, y in corners)
    assert camera.valid_radius_px is None or camera.valid_radius_px > farthest


@pytest.mark.parametrize("model", RICHER)
def test_coefficients_that_the_edges_leave_open_stay_those_of_lenses(model):
    camera = TrueCamera(1600.0, 1600.0, 639.5, 479.5, np.zeros(5), IMAGE_SIZE)
    edges = edges_of(squares(8, camera=camera), noise=1.5)
    result = ts.calibrate_edges(edges, IMAGE_SIZE, model=model)
    corner = np.hypot(*IMAGE_SIZE) / 2.0 / result.camera.fx
    largest = {"k3": 0.15 / corner**6, "p1": 0.006 / corner, "p2": 0.006 / corner}
    held = [name for name in largest if name in result.std]
    assert held
    for name in held:
        assert result.std[name] < largest[name]
