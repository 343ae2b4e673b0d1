"""The best accuracy that a scene's edges allow: the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, sample_sides

# A camera's parameter by name; a plane's by number: a small rotation (0 to 2), a translation (3 to
# 5) or the size of its hole (6).
Parameter: TypeAlias = str | int
InSight = Callable[[Array], npt.NDArray[np.bool_]]

# Central differences: relative to parameters near 1 this balances rounding and curvature at
# about 1e-9 of the derivative.
DIFFERENCE_STEP = 1e-5
# Smallest eigenvalue of the information matrix, scaled to unit diagonal, that differences of
# that accuracy distinguish from zero.
SINGULAR = 1e-13


def pixel_sigma(noise: float, contrast: float, blur: float) -> float:
    """Return the standard deviation of an edge's offset from one pixel of its length.

    ``noise / contrast * sqrt(2 sqrt(pi) s)`` with ``s^2 = blur^2 + 1/12``: the position of a
    Gaussian-blurred step from all pixels across it. Use it with ``spacing=1``.

    Parameters
    ----------
    noise, contrast : float
        Grey levels.
    blur : float
        Standard deviation of the optical blur, pixels.

    Returns
    -------
    float
        Pixels.
    """
    spread = np.sqrt(blur**2 + 1.0 / 12.0)
    return float(noise / contrast * np.sqrt(2.0 * np.sqrt(np.pi) * spread))


def cramer_rao_bound(
    scene: Scene,
    sigma: float,
    *,
    spacing: float = 1.0,
    free: Sequence[str] = ("fx", "fy", "cx", "cy", "k1", "k2"),
    in_sight: InSight | None = None,
    any_aspect: bool = False,
    any_offsets: bool = False,
    orthogonal: Sequence[tuple[int, int]] = (),
    further: Array | None = None,
) -> dict[str, float]:
    """Return the smallest standard deviations of an unbiased calibration of this scene.

    The information is that of the edges' offsets along their normals; every plane has six free
    parameters of its own, a frame one more for the size of its hole. The edges of a chessboard are
    its grid lines between the outermost crossings.

    Parameters
    ----------
    scene : Scene
        Squares, frames or chessboards.
    sigma : float
        Standard deviation of each offset, pixels.
    spacing : float
        Pixels of edge per offset.
    free : sequence of str
        Names among ``fx fy cx cy skew``, the lens's coefficients (``k1 k2 p1 p2 k3``, for a fisheye
        ``k1 k2 k3 k4``), and ``f`` for one scale common to fx and fy.
    in_sight : callable, optional
        Takes pixels, shape (N, 2); returns which of them the picture shows. Edges elsewhere,
        outside the picture or hidden, do not count.
    any_aspect : bool
        Whether the aspect of every figure is unknown as well.
    any_offsets : bool
        Whether the positions of a chessboard's grid lines are unknown as well, like those of a
        facade's lines.
    orthogonal : sequence of (int, int)
        Pairs of targets whose planes are known to be at right angles.
    further : ndarray, shape (len(free), len(free)), optional
        Information on the free parameters from other data.

    Returns
    -------
    dict of str to float
        One standard deviation for each free parameter (of fx for ``f``).

    Raises
    ------
    ValueError
        If the scene does not determine them.
    """
    jacobians = []
    for target in scene.targets:
        parameters = (*free, *range(6), *[6] * (target.kind == "frame"))
        sides = sample_sides(scene.camera, target, spacing)
        lengths = [len(side.plane) for side in sides]
        # A frame's hole comes after its outline.
        is_hole = np.repeat(np.arange(len(sides)) >= 4, lengths) & (target.kind == "frame")
        plane = np.concatenate([side.plane for side in sides])
        normal = np.concatenate([side.normal for side in sides])
        slopes = image_slopes(scene.camera, target, parameters, plane, is_hole)
        rows = np.sum(slopes * normal[:, None], axis=2)
        along_plane = rows[:, len(free) + 3 : len(free) + 6] @ target.rotation[:, :2]
        if any_aspect or any_offsets:
            rows = np.hstack([rows, along_plane[:, :1] * plane[:, :1]])
        if any_offsets:
            rows = np.hstack([rows, _offset_slopes(target, lengths, along_plane)])
        weights = np.repeat([side.length / spacing / len(side.plane) for side in sides], lengths)
        if in_sight is not None:
            weights = weights * in_sight(np.concatenate([side.image for side in sides]))
        jacobians.append(rows * np.sqrt(weights)[:, None] / sigma)
    size = len(free) + sum(rows.shape[1] - len(free) for rows in jacobians)
    information = np.zeros((size, size))
    first = len(free)
    turns = []
    for rows in jacobians:
        turns.append(slice(first, first + 3))
        after = first + rows.shape[1] - len(free)
        columns = np.r_[: len(free), first:after]
        information[np.ix_(columns, columns)] += rows.T @ rows
        first = after
    if further is not None:
        information[: len(free), : len(free)] += further
    if orthogonal:
        ties = np.zeros((len(orthogonal), size))
        for tie, (first_plane, second_plane) in zip(ties, orthogonal, strict=True):
            first_normal, second_normal = (
                scene.targets[plane].rotation[:, 2] for plane in (first_plane, second_plane)
            )
            tie[turns[first_plane]] = np.cross(first_normal, second_normal)
            tie[turns[second_plane]] = -tie[turns[first_plane]]
        # The directions that the ties leave free; they do not involve the camera.
        free_directions = np.linalg.svd(ties[:, len(free) :])[2][len(ties) :]
        basis = np.zeros((size, size - len(ties)))
        basis[: len(free), : len(free)] = np.eye(len(free))
        basis[len(free) :, len(free) :] = free_directions.T
        information = basis.T @ information @ basis
    return standard_deviations(information, free)


def _offset_slopes(target: Target, lengths: Sequence[int], along_plane: Array) -> Array:
    """Return derivatives of points on a board's grid lines by the offset of every line.

    There are `lengths` points on each line. The outermost lines have no offset: they define the
    plane's coordinates. `along_plane`, shape (N, 2), are the points' derivatives by the plane's X
    and Y.
    """
    columns, rows = target.inner_corners
    number = np.repeat(np.arange(rows + columns), lengths)
    inner_lines = [*range(1, rows - 1), *range(rows + 1, rows + columns - 1)]
    slopes = [along_plane[:, int(line < rows)] * (number == line) for line in inner_lines]
    return np.reshape(slopes, (len(inner_lines), len(number))).T


def standard_deviations(
    information: Array, names: Sequence[str], spread: Array | None = None
) -> dict[str, float]:
    """Return standard deviations from an information matrix whose first parameters have the names.

    `spread` is the covariance of the gradient if that is not the information itself.
    """
    diagonal = np.diag(information)
    if np.any(diagonal <= 0.0):
        raise ValueError("a parameter does not move any edge of the scene")
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] < SINGULAR:
        raise ValueError("the scene does not determine the free parameters")
    inverse = (vectors / values) @ vectors.T * np.outer(scale, scale)
    covariance = inverse if spread is None else inverse @ spread @ inverse
    variances = np.diag(covariance)
    return {name: float(np.sqrt(variances[i])) for i, name in enumerate(names)}


def image_slopes(
    camera: TrueCamera,
    target: Target,
    parameters: Sequence[Parameter],
    plane: Array,
    of_hole: npt.NDArray[np.bool_],
) -> Array:
    """Differentiate the images of a plane's points, (N, 2), by each parameter, shape (N, P, 2).

    Points `of_hole` move with the size of the target's hole.
    """

    def seen(parameter: Parameter, step: float) -> Array:
        moved, figure = changed(camera, target, parameter, step)
        scale = np.where(of_hole, figure.inner / target.inner, 1.0)
        return moved.project(figure.to_camera(plane * scale[:, None]))

    step = DIFFERENCE_STEP
    slopes = [(seen(name, step) - seen(name, -step)) / (2.0 * step) for name in parameters]
    return np.stack(slopes, axis=1)


def changed(
    camera: TrueCamera, target: Target, parameter: Parameter, step: float
) -> tuple[TrueCamera, Target]:
    """Change one parameter: a length in pixels, an angle in radians, or without a unit."""
    if parameter == "f":
        fy = camera.fy + step * camera.fy / camera.fx
        return replace(camera, fx=camera.fx + step, fy=fy), target
    names = camera.COEFFICIENTS
    if parameter in names:
        direction = np.eye(len(names))[names.index(str(parameter))]
        return replace(camera, distortion=camera.distortion + step * direction), target
    if isinstance(parameter, str):
        return replace(camera, **{parameter: getattr(camera, parameter) + step}), target
    if parameter == 6:
        return camera, replace(target, inner=target.inner + step)
    axis = np.eye(3)[parameter % 3]
    if parameter >= 3:
        return camera, replace(target, translation=target.translation + step * axis)
    turn = np.cross(axis, target.rotation, axisb=0, axisc=0)
    return camera, replace(target, rotation=target.rotation + step * turn)
