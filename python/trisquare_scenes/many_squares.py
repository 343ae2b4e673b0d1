"""Pictures of very many small squares with individual tilts, and of false ones among them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from trisquare._support.rotations import tilted
from trisquare.simulate import random_camera
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import placed
from trisquare_scenes.distractors import MixedScene

TILTS = (15.0, 40.0)
"""Range of tilts, degrees, in any direction: neighbouring squares have nothing in common."""

SIDES = (0.60, 0.70)
"""Range of the squares' sides before foreshortening, over a cell's: ground separates them."""

ASPECTS = (0.5, 0.9)
"""Range of shorter over longer side of false squares that are rectangles."""

ANGLES = (60.0, 82.0)
"""Range of the acute angles of false squares that are rhombi, degrees."""

MAX_SHIFT = 0.15
"""Maximum shift of each corner of those that are other quadrilaterals, over the side."""

MAX_DRAWS = 100
"""Maximum number of poses of one square, drawn by rejection."""

FalseShape = Literal["rectangle", "rhombus", "quadrilateral"]
FALSE_SHAPES: tuple[FalseShape, ...] = ("rectangle", "rhombus", "quadrilateral")


def many_squares(
    rng: np.random.Generator,
    count: int,
    *,
    false: int = 0,
    image_size: tuple[int, int] = (4000, 3000),
    camera: TrueCamera | None = None,
) -> MixedScene:
    """Draw `count` squares in the cells of a picture, some of which are false.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    count : int
        Number of squares, including the false ones.
    false : int
        Number of those that are rectangles, rhombi or other quadrilaterals, in turn.
    image_size : tuple of int
        Width and height, pixels; those of `camera` if that is given.
    camera : TrueCamera, optional
        The camera; drawn if not given.

    Returns
    -------
    MixedScene
    """
    camera = camera or random_camera(rng, image_size)
    width, height = camera.image_size
    columns = int(np.ceil(np.sqrt(count * width / height)))
    rows = -(-count // columns)
    cell = np.array([width / columns, height / rows])
    shapes: list[FalseShape | None] = [None] * count
    for i, place in enumerate(rng.permutation(count)[:false]):
        shapes[place] = FALSE_SHAPES[i % len(FALSE_SHAPES)]
    targets = []
    for i, shape in enumerate(shapes):
        middle = cell * (i % columns + 0.5, i // columns + 0.5)
        targets.append(_drawn(rng, camera, middle, float(cell.min()), shape))
    return MixedScene(Scene(camera, tuple(targets)), tuple(shape is None for shape in shapes))


def _drawn(
    rng: np.random.Generator,
    camera: TrueCamera,
    middle: Array,
    cell: float,
    shape: FalseShape | None,
) -> Target:
    for _ in range(MAX_DRAWS):
        rotation = tilted(rng.uniform(*TILTS), rng.uniform(0.0, 360.0), rng.uniform(0.0, 360.0))
        side = cell * rng.uniform(*SIDES)
        centre = np.append(camera.undistort(middle[None])[0], 1.0) * camera.fx / side
        target = placed(camera, rotation, centre, printed=_corners(rng, shape))
        if target is not None:
            return target
    raise ValueError(f"no square fits the picture about {middle}")


def _corners(rng: np.random.Generator, shape: FalseShape | None) -> Array | None:
    """Return corners of a false square in a unit square's circumscribed circle, shape (4, 2)."""
    if shape is None:
        return None
    if shape == "rectangle":
        corners = rectangle(1.0, rng.uniform(*ASPECTS))
    elif shape == "rhombus":
        half = 0.5 * np.deg2rad(rng.uniform(*ANGLES))
        corners = rectangle(1.0, 1.0) * np.tile([[np.cos(half)], [np.sin(half)]], (2, 1))
    else:
        corners = rectangle(0.5, 0.5) + rng.uniform(-MAX_SHIFT, MAX_SHIFT, (4, 2))
    return np.asarray(corners * np.sqrt(0.5) / np.linalg.norm(corners, axis=1).max())
