"""Exact grey profiles of a step edge and of a corner after optical blur and the pixel's box.

A pixel reports the mean, over its unit square, of the Gaussian-blurred scene. Both profiles are
evaluated in closed form or by Gauss-Legendre quadrature of a smooth function; nothing is
supersampled.
"""

from __future__ import annotations

import math

import numpy as np

from trisquare.simulate.scene import Array

# The normal cdf is a table of erfc plus five Taylor terms: with nodes 1/64 apart the sixth
# is below 1e-15, and beyond 9 standard deviations the tail is below 1e-18.
_NODES_PER_UNIT = 64
_CDF_REACH = 9
_NODES = (
    np.arange(-_CDF_REACH * _NODES_PER_UNIT, _CDF_REACH * _NODES_PER_UNIT + 1) / _NODES_PER_UNIT
)
_CDF = np.array([0.5 * math.erfc(-x / math.sqrt(2.0)) for x in _NODES])
_PDF = np.exp(-0.5 * _NODES**2) / math.sqrt(2.0 * math.pi)

# Width (in blurs) of the box's narrow side below which two terms of the box's moment series replace
# the second difference, which cancels. At this width the errors are 1e-10 and 4e-12.
_NARROW_BOX = 0.02

# Integrates a wedge blurred by 0.3 px over the pixel's unit side to 1e-6.
_PIXEL_NODES, _PIXEL_WEIGHTS = np.polynomial.legendre.leggauss(6)
# Integrates the correlation up to |rho| = 0.95 (a corner of 18 degrees) to 1e-7.
_ANGLE_NODES, _ANGLE_WEIGHTS = np.polynomial.legendre.leggauss(20)


def normal_pdf(x: Array) -> Array:
    """Return the standard normal density."""
    density: Array = np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
    return density


def normal_cdf(x: Array) -> Array:
    """Return the standard normal distribution function, to rounding."""
    x = np.clip(x, -_CDF_REACH, _CDF_REACH)
    index = np.rint((x + _CDF_REACH) * _NODES_PER_UNIT).astype(np.intp)
    a = _NODES[index]
    h = x - a
    a2 = a * a
    series = ((a2 - 6.0) * a2 + 3.0) / 120.0
    for coefficient in ((3.0 - a2) * a / 24.0, (a2 - 1.0) / 6.0, -a / 2.0, 1.0):
        series = coefficient + h * series
    cdf: Array = _CDF[index] + _PDF[index] * h * series
    return cdf


def blurred_step(distance: Array, normal: Array, blur: float) -> Array:
    """Return the grey values, 0 to 1, of pixels near a straight step edge, shape (N,).

    The pixels are at signed distances, shape (N,), from the edge, pixels, positive on the bright
    side, to which its unit normals, shape (N, 2), point. Along the normal n the pixel's square acts
    as two boxes of widths |nx| and |ny|, so the profile is a second difference of the twice
    integrated normal distribution.
    """
    x = distance / blur
    widths = np.abs(normal) / blur
    wide, narrow = widths.max(axis=1), widths.min(axis=1)
    safe = np.maximum(narrow, _NARROW_BOX)
    outer, inner = 0.5 * (wide + safe), 0.5 * (wide - safe)
    exact = (
        _second_integral(x + outer)
        - _second_integral(x + inner)
        - _second_integral(x - inner)
        + _second_integral(x - outer)
    ) / (wide * safe)
    ahead, behind = x + 0.5 * wide, x - 0.5 * wide
    series = (
        _first_integral(ahead)
        - _first_integral(behind)
        + narrow**2 / 24.0 * (normal_pdf(ahead) - normal_pdf(behind))
    ) / wide
    grey: Array = np.where(narrow >= _NARROW_BOX, exact, series)
    return grey


def blurred_wedge(
    distance1: Array, distance2: Array, normal1: Array, normal2: Array, blur: float
) -> Array:
    """Return the grey values, 0 to 1, of pixels near a corner, where both distances are positive.

    Distances and inward normals are as of `blurred_step`. A Gaussian-blurred wedge is the
    bivariate normal distribution function of the two signed distances with correlation n1 . n2;
    the pixel's box is integrated by quadrature.
    """
    nodes = 0.5 * np.stack(np.meshgrid(_PIXEL_NODES, _PIXEL_NODES), axis=-1).reshape(-1, 2)
    weights = 0.25 * np.outer(_PIXEL_WEIGHTS, _PIXEL_WEIGHTS).ravel()
    h = (distance1[:, None] + normal1 @ nodes.T) / blur
    k = (distance2[:, None] + normal2 @ nodes.T) / blur
    correlation = np.sum(normal1 * normal2, axis=1)
    grey: Array = bivariate_normal_cdf(h, k, correlation[:, None]) @ weights
    return grey


def bivariate_normal_cdf(h: Array, k: Array, correlation: Array) -> Array:
    """Return the probability that X < h and Y < k for standard normals of the given correlation.

    ``Phi(h) Phi(k) + 1/(2 pi) int_0^asin(rho) exp(-(h^2 + k^2 - 2 h k sin t) / (2 cos^2 t)) dt``
    (Genz, Statistics and Computing 14 (2004) 251-260, doi:10.1023/B:STCO.0000035304.20635.31),
    accurate to 1e-7 for ``|rho| <= 0.95``. The arguments broadcast.
    """
    half_angle = 0.5 * np.arcsin(correlation)
    squares, product = 0.5 * (h * h + k * k), h * k
    total = np.zeros(np.broadcast(squares, half_angle).shape)
    for node, weight in zip(_ANGLE_NODES, _ANGLE_WEIGHTS, strict=True):
        sine = np.sin(half_angle * (1.0 + node))
        total += weight * np.exp((product * sine - squares) / (1.0 - sine * sine))
    cdf: Array = normal_cdf(h) * normal_cdf(k) + half_angle / (2.0 * math.pi) * total
    return cdf


def _first_integral(x: Array) -> Array:
    """Return the integral of the normal distribution function from minus infinity to x."""
    return x * normal_cdf(x) + normal_pdf(x)


def _second_integral(x: Array) -> Array:
    """Return the integral of `_first_integral` from minus infinity to x."""
    return 0.5 * ((x * x + 1.0) * normal_cdf(x) + x * normal_pdf(x))
