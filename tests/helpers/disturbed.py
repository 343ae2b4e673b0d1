"""Edge samples with errors that a calibration should detect."""

import numpy as np

from trisquare import PlaneEdges
from trisquare.simulate.scene import sample_sides

SPACING = 4.0


def white(rng, plane, side, place):
    """Independent errors; `place` runs from -1 to 1 along the side."""
    return rng.standard_normal(len(place))


def neighbours_correlated(correlation):
    """A first-order autoregression along each side."""

    def errors(rng, plane, side, place):
        error = rng.standard_normal(len(place))
        for i in range(1, len(error)):
            error[i] = correlation * error[i - 1] + np.sqrt(1.0 - correlation**2) * error[i]
        return error

    return errors


def rough(plane, factor):
    """Independent errors, larger on one plane."""
    return lambda rng, p, side, place: (factor if p == plane else 1.0) * white(rng, p, side, place)


def displaced(amount):
    """Every side bent and shifted by four Legendre polynomials, all of the same rms."""

    def errors(rng, plane, side, place):
        shapes = np.polynomial.legendre.legvander(place, 3) * np.sqrt([1.0, 3.0, 5.0, 7.0])
        return white(rng, plane, side, place) + shapes @ rng.normal(0.0, amount, 4)

    return errors


def bowed(plane, side, height):
    """Independent errors, and one side bent to a parabola."""

    def errors(rng, p, s, place):
        bow = height * (1.0 - place**2) if (p, s) == (plane, side) else 0.0
        return white(rng, p, s, place) + bow

    return errors


def disturbed_edges(scene, errors, noise, seed):
    """The squares of a scene, their samples displaced by `noise` times the errors drawn."""
    rng = np.random.default_rng(seed)
    edges = []
    for plane, target in enumerate(scene.targets):
        points = []
        for number, side in enumerate(sample_sides(scene.camera, target, SPACING)):
            count = len(side.image)
            place = (2.0 * np.arange(count) + 1.0) / count - 1.0
            off = noise * errors(rng, plane, number, place)
            points.append(side.image + off[:, None] * side.normal)
        edges.append(PlaneEdges.square(points))
    return edges
