"""One photograph of the printed corner beside 13 of a chessboard, and what other sheets promise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from accuracy.against_zhang import photograph_boards, zhang_camera
from experiments.estimators import Error, error_of
from harness.truth import PINHOLE

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import Scene, Side, Target, rectangle, sides_of

SEED = 18
SCENES = 24
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
WINDOWS = (5, 11)  # half windows of cornerSubPix, pixels
TARGET = 0.6
SIGMA = 0.02  # pixels per pixel of edge

NESTED = ((1.0, 0.6), (1.0, 0.8, 0.6, 0.4), (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3))
"""Sides of the squares one in another that a face of the sheet could carry; the first is today's."""

CELLS = (8, 12, 16)
"""Of chessboards that cover a face, margins and all."""


@dataclass(frozen=True, slots=True, eq=False)
class NestedSquares(Target):
    """Squares one in another, of sides that are known."""

    scales: tuple[float, ...] = (1.0,)

    def sides(self) -> list[Side]:
        """Sides of all squares."""
        return [side for scale in self.scales for side in sides_of(scale * rectangle(0.5, 0.5))]


def errors_of(number: int) -> dict[str, Error]:
    """Return the errors of one camera from its corner, and from its boards by window."""
    rng = np.random.default_rng([SEED, number])
    camera = simulate.random_camera(rng)
    photo = {"noise": rng.uniform(*NOISE_RANGE), "blur": rng.uniform(*BLUR_RANGE)}
    scene = simulate.corner_scene(rng, camera=camera)
    picture = simulate.render(scene, rng, tone="linear", **photo)
    found = {"corner": error_of(lambda: ts.calibrate(picture, tone="linear"), camera)}
    boards = photograph_boards(camera, rng, photo)
    for window in WINDOWS:
        found[f"boards_{window}"] = error_of(
            lambda window=window: zhang_camera(camera, boards, window), camera
        )
    return found


def promised(number: int) -> dict[str, float]:
    """Return the rms of the least standard deviations of fx, fy, cx, cy, by what the sheet has."""
    rng = np.random.default_rng([SEED, number])
    scene = simulate.corner_scene(rng, camera=simulate.random_camera(rng))
    found = {}
    for name, sheet in _sheets(scene):
        bound = simulate.cramer_rao_bound(sheet, SIGMA)
        found[name] = float(np.sqrt(np.mean([bound[parameter] ** 2 for parameter in PINHOLE])))
    return found


def _sheets(scene: Scene) -> Iterator[tuple[str, Scene]]:
    for scales in NESTED:
        targets = tuple(
            NestedSquares(target.rotation, target.translation, scales=scales)
            for target in scene.targets
        )
        yield f"{len(scales)} squares one in another", replace(scene, targets=targets)
    for cells in CELLS:
        targets = tuple(
            replace(
                target,
                kind="chessboard",
                inner_corners=(cells - 1, cells - 1),
                translation=target.translation * cells / (1.0 + 2.0 * (target.rim or 0.0)),
            )
            for target in scene.targets
        )
        yield f"a chessboard of {cells} x {cells} cells", replace(scene, targets=targets)
