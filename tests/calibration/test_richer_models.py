"""Models with more coefficients than the default: never worse than the poorer, never absurd."""

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import TrueCamera

RICHER = ("radial3", "brown")


def wide_edges(seed, count=3):
    """Edges that a wide lens outside all models sees."""
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


def answer(seed, model, count=3):
    try:
        return ts.calibrate_edges(wide_edges(seed, count), IMAGE_SIZE, model=model)
    except ts.TrisquareError as error:
        return error


def cost(result, scale):
    distances = np.concatenate([own for figure in result.residuals for own in figure.distances])
    return (1.0 - (1.0 - np.minimum(np.abs(distances) / scale / 7.041, 1.0) ** 2) ** 3).sum()
