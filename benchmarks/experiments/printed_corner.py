"""One photograph of a printed corner beside 13 of a chessboard; predictions for other sheets."""

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
"""Sides of nested squares that a face could carry; the first is the frame's."""

CELLS = (8, 12, 18)
"""Number of cells along a chessboard's side; the last is that of the printed one."""

SHEETS = ("frames", "boards")
"""Printed corners of three frames, and of three chessboards."""


@dataclass(frozen=True, slots=True, eq=False)
class NestedSquares(Target):
    """Nested squares with known sides."""

    scales: tuple[float, ...] = (1.0,)

    def sides(self) -> list[Side]:
        """Return the sides of all squares."""
        return [side for scale in self.scales for side in sides_of(scale * rectangle(0.5, 0.5))]


def errors_of(number: int) -> dict[str, Error]:
    """Return the errors of one camera, by sheet and, for 13 boards, by half window."""
    rng = np.random.default_rng([SEED, number])
    camera = simulate.random_camera(rng)
    photo = {"noise": rng.uniform(*NOISE_RANGE), "blur": rng.uniform(*BLUR_RANGE)}
    found = {}
    for sheet, kind in zip(SHEETS, ("corner", "boards"), strict=True):
        (page,) = ts.printed_target(kind).pages
        scene = simulate.corner_scene(rng, page=page, camera=camera)
        picture = simulate.render(scene, rng, tone="linear", **photo)
        found[sheet] = error_of(lambda: ts.calibrate(picture, tone="linear"), camera)  # noqa: B023
    boards = photograph_boards(camera, rng, photo)
    for window in WINDOWS:
        found[f"zhang_{window}"] = error_of(
            lambda: zhang_camera(camera, boards, window),  # noqa: B023
            camera,
        )
    return found


def predicted(number: int) -> dict[str, float]:
    """Return the rms of the lower bounds on the stds of fx, fy, cx, cy, by sheet."""
    rng = np.random.default_rng([SEED, number])
    scene = simulate.corner_scene(rng, camera=simulate.random_camera(rng))
    found = {}
    for name, sheet in _sheets(scene):
        bound = simulate.cramer_rao_bound(sheet, SIGMA)
        found[name] = float(np.sqrt(np.mean([bound[parameter] ** 2 for parameter in PINHOLE])))
    return found


def _sheets(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """Replace the figures on the sheet's faces; the boards are as large as the printed ones."""
    for scales in NESTED:
        targets = tuple(
            NestedSquares(target.rotation, target.translation, scales=scales)
            for target in scene.targets
        )
        yield f"{len(scales)} squares one in another", replace(scene, targets=targets)
    frame, board = (ts.printed_target(kind).pages[0].frames[0] for kind in ("corner", "boards"))
    for cells in CELLS:
        unit = board.side / frame.side / cells
        targets = tuple(
            Target(
                target.rotation,
                target.translation / unit,
                "chessboard",
                inner_corners=(cells - 1, cells - 1),
            )
            for target in scene.targets
        )
        yield f"a chessboard of {cells} x {cells} cells", replace(scene, targets=targets)
