"""The best accuracy that a rendered picture itself allows, with every pixel along its edges.

`cramer_rao_bound` assumes that an edge is alone and evenly lit, and that its noise is white. In a
picture edges cross and reduce each other's contrast, light falls off, and JPEG's errors are
correlated: here slopes and errors are those of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from trisquare.simulate.cramer_rao import (
    InSight,
    image_slopes,
    standard_deviations,
)
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, sample_sides
from trisquare_scenes.tagged import MarkedTarget

BAND_BLURS = 3.0
"""Distance from an edge, in blurs, within which pixels contain information on its position."""

BLOCK = 8
"""Side in pixels of the blocks in which JPEG codes the picture: their errors are assumed to be
independent of each other, though not within a block."""


def picture_bound(
    scene: Scene,
    ideal: npt.NDArray[np.float32],
    wrong: npt.NDArray[np.float32],
    blur: float,
    *,
    free: Sequence[str] = ("fx", "fy", "cx", "cy", "k1", "k2"),
    in_sight: InSight | None = None,
) -> dict[str, float]:
    """Return standard deviations of least squares on all pixels along a scene's edges.

    With `J` the derivatives of the pixels by all parameters and `e` their errors, these are the
    roots of the diagonal of ``(J^T J)^-1 (sum_b g_b g_b^T) (J^T J)^-1`` where ``g_b = J_b^T e_b``
    sums over the pixels of block `b` (P. J. Huber, Proc. 5th Berkeley Symp. 1 (1967) 221-233): the
    Cramer-Rao bound if the errors are white.

    Parameters
    ----------
    scene : Scene
        The targets to calibrate from.
    ideal, wrong : ndarray, shape (H, W)
        The grey picture without noise, and the photograph's errors.
    blur : float
        Standard deviation of the optical blur, pixels.
    free : sequence of str
        As for `cramer_rao_bound`.
    in_sight : callable, optional
        Takes pixels, shape (N, 2); returns which of them show the scene.

    Returns
    -------
    dict of str to float
        One standard deviation for each free parameter.

    Raises
    ------
    ValueError
        If the picture does not determine them.
    """
    information, gradients = _sums(scene, ideal, wrong, blur, free, in_sight)
    return standard_deviations(information, free, gradients.T @ gradients)


def _sums(
    scene: Scene,
    ideal: npt.NDArray[np.float32],
    wrong: npt.NDArray[np.float32],
    blur: float,
    free: Sequence[str],
    in_sight: InSight | None,
) -> tuple[Array, Array]:
    """Return `J^T J`, shape (P, P), and `J_b^T e_b` of all blocks, shape (B, P)."""
    slopes = [_slope(ideal, axis) for axis in (1, 0)]
    counts = [6 + (target.kind == "frame") for target in scene.targets]
    size = len(free) + sum(counts)
    information = np.zeros((size, size))
    blocks: dict[int, Array] = {}
    first = len(free)
    for target, count in zip(scene.targets, counts, strict=True):
        pixels = _along_edges(scene.camera, target, ideal.shape, blur)
        if in_sight is not None:
            pixels = pixels[in_sight(pixels.astype(np.float64))]
        plane = _plane_points(scene.camera, target, pixels.astype(np.float64))
        if isinstance(target, MarkedTarget) and target.is_board:
            is_line = ~_is_marker(target, plane)
            pixels, plane = pixels[is_line], plane[is_line]
        x, y = pixels.T
        # Points of a frame that are nearer to the hole than to the outline move with the hole.
        is_hole = np.abs(plane).max(axis=1) < 0.25 * (1.0 + target.inner)
        is_hole &= target.kind == "frame"
        flow = -image_slopes(scene.camera, target, (*free, *range(count)), plane, is_hole)
        rows = flow[..., 0] * slopes[0][y, x, None] + flow[..., 1] * slopes[1][y, x, None]
        columns = np.r_[: len(free), first : first + count]
        information[np.ix_(columns, columns)] += rows.T @ rows
        number = (y // BLOCK) * (ideal.shape[1] // BLOCK + 1) + x // BLOCK
        for block, gradient in zip(*_summed(number, rows * wrong[y, x, None]), strict=True):
            blocks.setdefault(block, np.zeros(size))[columns] += gradient
        first += count
    return information, np.array(list(blocks.values()))


def _slope(picture: npt.NDArray[np.float32], axis: int) -> Array:
    """Return the derivative along an axis by a Fourier series, exact to the pixels' frequency."""
    mirrored = np.concatenate([picture, np.flip(picture, axis)], axis).astype(np.float64)
    count = mirrored.shape[axis]
    frequency = 2.0 * np.pi * np.fft.rfftfreq(count)
    if axis == 0:
        frequency = frequency[:, None]
    derivative = np.fft.irfft(1j * frequency * np.fft.rfft(mirrored, axis=axis), count, axis)
    return np.asarray(np.take(derivative, range(picture.shape[axis]), axis))


def _along_edges(
    camera: TrueCamera, target: Target, shape: tuple[int, ...], blur: float
) -> npt.NDArray[np.intp]:
    """Return pixels x, y near a target's sides or grid lines, shape (N, 2)."""
    mask = np.zeros(shape, np.uint8)
    width = int(np.ceil(2.0 * BAND_BLURS * np.hypot(blur, 12.0**-0.5))) + 1
    for side in sample_sides(camera, target, 2.0):
        path = np.rint(side.image).astype(np.int32)
        cv2.polylines(mask, [path.reshape(-1, 1, 2)], False, 1, width)
    y, x = np.nonzero(mask)
    return np.stack([x, y], axis=1)


def _plane_points(camera: TrueCamera, target: Target, pixels: Array) -> Array:
    """Return points of the target's plane that pixels show, shape (N, 2)."""
    rays = np.column_stack([camera.undistort(pixels), np.ones(len(pixels))])
    axes = np.column_stack([target.rotation[:, :2], target.translation])
    plane = np.linalg.solve(axes, rays.T).T
    return np.asarray(plane[:, :2] / plane[:, 2:])


def _is_marker(target: Target, plane: Array) -> npt.NDArray[np.bool_]:
    """Return whether points of a ChArUco board are nearer to a marker's border than a grid line."""
    cells = plane + 0.5 * (np.array(target.inner_corners) + 1.0)
    is_light = np.floor(cells).sum(axis=1) % 2.0 == 1.0
    offsets = np.abs(cells - np.floor(cells) - 0.5).max(axis=1)
    return np.asarray(is_light & (offsets < 0.25 * (1.0 + target.inner)))


def _summed(number: npt.NDArray[np.intp], rows: Array) -> tuple[list[int], Array]:
    """Return the sums of rows of equal number."""
    order = np.argsort(number, kind="stable")
    kinds, starts = np.unique(number[order], return_index=True)
    return kinds.tolist(), np.add.reduceat(rows[order], starts, axis=0)
