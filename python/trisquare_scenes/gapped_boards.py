"""Chessboards whose dark cells do not quite touch, or overlap, as in print and on displays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trisquare._support.rotations import tilted
from trisquare.simulate import random_camera
from trisquare.simulate.scene import Scene, Side, Target, TrueCamera, rectangle, sides_of
from trisquare.simulate.scenes import faces_camera, inside

CELLS = (15.0, 90.0)
"""Range of the cells' sides before tilting, pixels."""

MAX_TILTED = 45.0  # degrees

FEWEST, MOST = (4, 4), (13, 10)
"""Minimum and maximum numbers of a board's inner corners: columns and rows."""

FILLED = 0.85
"""Maximum fraction of the picture that a board takes before tilting."""

MAX_DRAWS = 5000


@dataclass(frozen=True, slots=True, eq=False)
class GappedBoard(Target):
    """A chessboard whose dark cells are too small, or too large.

    Parameters
    ----------
    gap : float
        Distance from each side of a dark cell to that of the next one across a grid line, in
        cells: negative if they overlap.
    """

    gap: float = 0.0

    def figure(self) -> Iterator[tuple[float, list[Side]]]:
        """Yield the signs and the sides of convex quadrilaterals whose sum is the figure."""
        half = 0.5 * (1.0 - self.gap)
        for centre in self.cells(0):
            yield 1.0, sides_of(centre + rectangle(half, half))
        if self.gap < 0.0:
            # The part that two dark cells share is dark only once.
            for crossing in self.board_corners():
                yield -1.0, sides_of(crossing + rectangle(-0.5 * self.gap, -0.5 * self.gap))


def gapped_scene(
    rng: np.random.Generator,
    gap: float,
    *,
    cell: float | None = None,
    camera: TrueCamera | None = None,
) -> Scene:
    """Draw one board in any pose with its dark cells `gap` pixels apart before it is tilted.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    gap : float
        Pixels between dark cells; negative if they overlap.
    cell : float, optional
        Side of the cells, pixels; drawn from `CELLS` if not given.
    camera : TrueCamera, optional
        The camera; drawn if not given.
    """
    camera = camera or random_camera(rng)
    cell = cell or float(np.exp(rng.uniform(*np.log(CELLS))))
    width, height = camera.image_size
    most = [
        min(m, int(FILLED * size / cell) - 1) for m, size in zip(MOST, (width, height), strict=True)
    ]
    for _ in range(MAX_DRAWS):
        columns, rows = (
            int(rng.integers(low, high + 1)) for low, high in zip(FEWEST, most, strict=True)
        )
        rotation = tilted(
            rng.uniform(0.0, MAX_TILTED), rng.uniform(0.0, 360.0), rng.uniform(0.0, 360.0)
        )
        pixel = rng.uniform(0.2, 0.8, 2) * [width, height]
        centre = np.append(camera.undistort(pixel[None])[0], 1.0) * camera.fx / cell
        if not faces_camera(rotation, centre):
            continue
        board = GappedBoard(
            rotation, centre, kind="chessboard", inner_corners=(columns, rows), gap=gap / cell
        )
        if inside(camera, board):
            return Scene(camera, (board,))
    raise ValueError("no board fits this camera's picture")
