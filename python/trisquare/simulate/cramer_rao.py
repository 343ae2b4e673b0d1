"""The best accuracy that a scene's edges allow: the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from trisquare.simulate.scene import Scene, SideSamples, Target, TrueCamera, sample_sides

Array = npt.NDArray[np.float64]
Change = Callable[[TrueCamera, Target, float], tuple[TrueCamera, Target]]
InSight = Callable[[Array], npt.NDArray[np.bool_]]

DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3")
# Central differences: relative to parameters near 1 this balances rounding and curvature at
# about 1e-9 of the derivative.
DIFFERENCE_STEP = 1e-5
# Smallest eigenvalue of the information matrix, scaled to unit diagonal, that differences of
# that quality can tell from zero.
SINGULAR = 1e-13


def pixel_sigma(noise: float, contrast: float, blur: float) -> float:
    """Return the standard deviation of an edge's offset known from one pixel of its length.

    ``noise / contrast * sqrt(2 sqrt(pi) s)`` with ``s^2 = blur^2 + 1/12``: what all pixels across
    a Gaussian-blurred step together know of its position. Use it with ``spacing=1``.

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
) -> dict[str, float]:
    """Smallest standard deviations that an unbiased calibration of this scene can have.

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
        Of ``fx fy cx cy k1 k2 p1 p2 k3``, and ``f`` for one scale common to fx and fy.
    in_sight : callable, optional
        Tells of pixels, shape (N, 2), which of them the picture shows; edges elsewhere, outside
        the picture or hidden, do not count.

    Returns
    -------
    dict of str to float
        One standard deviation for each free parameter (of fx for ``f``).

    Raises
    ------
    ValueError
        If the scene does not determine them.
    """
    counts = [6 + (target.kind == "frame") for target in scene.targets]
    size = len(free) + sum(counts)
    information = np.zeros((size, size))
    first = len(free)
    for target, count in zip(scene.targets, counts, strict=True):
        changes = changes_of(free, count)
        columns = np.r_[: len(free), first : first + count]
        sides = sample_sides(scene.camera, target, spacing)
        rows, weights = _offset_jacobian(scene.camera, target, sides, changes, spacing)
        if in_sight is not None:
            weights = weights * in_sight(np.concatenate([side.image for side in sides]))
        information[np.ix_(columns, columns)] += (rows * weights[:, None]).T @ rows / sigma**2
        first += count
    return standard_deviations(information, free)


def standard_deviations(
    information: Array, names: Sequence[str], spread: Array | None = None
) -> dict[str, float]:
    """Invert an information matrix whose first parameters have the given names.

    `spread` is the covariance of the gradient where that is not the information itself.
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


def _offset_jacobian(
    camera: TrueCamera,
    target: Target,
    sides: list[SideSamples],
    changes: list[Change],
    spacing: float,
) -> tuple[Array, Array]:
    """Differentiate the edges' offsets by each change, shape (N, P); weights, shape (N,)."""
    plane = np.concatenate([side.plane for side in sides])
    normal = np.concatenate([side.normal for side in sides])
    weights = np.concatenate(
        [np.full(len(side.plane), side.length / spacing / len(side.plane)) for side in sides]
    )
    hole = np.arange(len(sides)) >= (4 if target.kind == "frame" else len(sides))
    of_hole = np.repeat(hole, [len(side.plane) for side in sides])
    derivatives = []
    for change in changes:
        moved = [
            project_outlines(*change(camera, target, step), target.inner, plane, of_hole)
            for step in (DIFFERENCE_STEP, -DIFFERENCE_STEP)
        ]
        slope = (moved[0] - moved[1]) / (2.0 * DIFFERENCE_STEP)
        derivatives.append(np.sum(slope * normal, axis=1))
    return np.stack(derivatives, axis=1), weights


def project_outlines(
    camera: TrueCamera, target: Target, inner: float, plane: Array, of_hole: npt.NDArray[np.bool_]
) -> Array:
    """Project outline points, those of the hole scaled from size `inner` to the target's own."""
    scale = np.where(of_hole, target.inner / inner, 1.0)
    return camera.project(target.to_camera(plane * scale[:, None]))


def changes_of(free: Sequence[str], of_plane: int) -> list[Change]:
    """Return the changes of the free camera parameters, and those of a plane."""
    return [_camera_change(name) for name in free] + [_plane_change(i) for i in range(of_plane)]


def _camera_change(name: str) -> Change:
    """Return a change of one camera parameter, lengths in pixels."""
    if name == "f":
        return lambda camera, target, step: (
            replace(camera, fx=camera.fx + step, fy=camera.fy + step * camera.fy / camera.fx),
            target,
        )
    if name in ("fx", "fy", "cx", "cy"):
        return lambda camera, target, step: (
            replace(camera, **{name: getattr(camera, name) + step}),
            target,
        )
    direction = np.eye(5)[DISTORTION_NAMES.index(name)]
    return lambda camera, target, step: (
        replace(camera, distortion=camera.distortion + step * direction),
        target,
    )


def _plane_change(index: int) -> Change:
    """Return a change of a plane: a small turn (0-2), a shift (3-5) or the hole's size (6)."""
    if index == 6:
        return lambda camera, target, step: (camera, replace(target, inner=target.inner + step))
    direction = np.eye(3)[index % 3]
    if index >= 3:
        return lambda camera, target, step: (
            camera,
            replace(target, translation=target.translation + step * direction),
        )
    x, y, z = direction
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return lambda camera, target, step: (
        camera,
        replace(target, rotation=target.rotation + step * turn @ target.rotation),
    )
