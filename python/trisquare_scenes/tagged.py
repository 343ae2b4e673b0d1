"""Seeded scenes of tags and of boxes with printed sheets, for `trisquare.simulate.render`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trisquare._support.rotations import tilted
from trisquare.detection.tags.codes import dictionary
from trisquare.detection.tags.decode import BORDER
from trisquare.simulate import random_camera
from trisquare.simulate.render import SHEET_RIM
from trisquare.simulate.scene import Array, Scene, Side, Target, TrueCamera, rectangle, sides_of

Codes = npt.NDArray[np.bool_]

PLACES = np.array([[0.23, 0.3], [0.77, 0.3], [0.5, 0.72]])
"""Centres of three tags, as fractions of the picture."""

TAG_SIDES = (60.0, 250.0)  # pixels, before foreshortening
TAG_TILTS = (25.0, 60.0)  # degrees
TILT_DIRECTION_JITTER = 20.0  # degrees

BOX_TILTS = (48.0, 62.0)
"""Range of the angles between a box's faces and the picture, degrees: 54.7 when its corner points
at the camera."""

BOX_MARGIN = 0.08
"""Margin between a face's sheet and the box's edges, over the face's side."""

PICTURE_MARGIN = 12.0  # pixels
MAX_DRAWS = 5000


@dataclass(frozen=True, slots=True, eq=False)
class MarkedTarget(Target):
    """A square tag with a code, or a chessboard with markers in its light cells (ChArUco).

    Parameters
    ----------
    inner : float
        Side of a board's markers, in cells.
    codes : array_like of bool, shape (M, n, n)
        Code of a tag (M = 1), or of a board's markers row by row: True is white. A border of one
        dark cell surrounds each.
    """

    codes: Codes = field(default_factory=lambda: np.zeros((0, 1, 1), bool))

    def figure(self) -> Iterator[tuple[float, list[Side]]]:
        """Yield the signs and the sides of convex quadrilaterals whose sum is the figure."""
        if not self.is_board:
            yield from marker(self.codes[0], np.zeros(2), 1.0)
            return
        yield from Target.figure(self)
        # Only as many markers as there are codes: the remaining light cells stay empty.
        for centre, code in zip(self.cells(1), self.codes, strict=False):
            yield from marker(code, centre, self.inner)


def marker(
    code: Codes, centre: Array, side: float, border: int = BORDER
) -> Iterator[tuple[float, list[Side]]]:
    """Yield a dark square of the given side and, subtracted from it, the code's runs of white."""
    yield 1.0, sides_of(centre + side * rectangle(0.5, 0.5))
    cells = len(code) + 2 * border
    cell = side / cells
    for row, bits in enumerate(code.astype(np.int8)):
        steps = np.diff(bits, prepend=0, append=0)
        for start, end in zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True):
            middle = np.array([0.5 * (start + end), row + 0.5]) + border - 0.5 * cells
            white = rectangle(0.5 * cell * float(end - start), 0.5 * cell)
            yield -1.0, sides_of(centre + cell * middle + white)


def tag_scene(
    rng: np.random.Generator,
    name: str = "6X6_250",
    *,
    sides: tuple[float, float] = TAG_SIDES,
    camera: TrueCamera | None = None,
) -> tuple[Scene, list[int]]:
    """Draw three tags that stand alone; return their scene and their numbers.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    name : str
        One of `trisquare.detection.tags.families.DICTIONARIES`.
    sides : tuple of float
        Range of the tags' sides, pixels.
    camera : TrueCamera, optional
        The camera; drawn if not given.
    """
    camera = camera or random_camera(rng)
    codes = dictionary(name).codes
    numbers = rng.choice(len(codes), 3, replace=False).tolist()
    first = rng.uniform(0.0, 360.0)
    targets = []
    for i, (place, number) in enumerate(zip(PLACES, numbers, strict=True)):
        for _ in range(MAX_DRAWS):
            direction = first + 120.0 * i + rng.uniform(-1.0, 1.0) * TILT_DIRECTION_JITTER
            rotation = tilted(rng.uniform(*TAG_TILTS), direction, rng.uniform(0.0, 360.0))
            centre = np.append(camera.undistort((place * camera.image_size)[None])[0], 1.0)
            centre *= camera.fx / rng.uniform(*sides)
            # Beyond 70 degrees from the line of sight little of the smallest remains.
            if rotation[:, 2] @ centre > np.cos(np.deg2rad(70.0)) * np.linalg.norm(centre):
                tag = MarkedTarget(rotation, centre, codes=codes[[number]])
                if in_picture(camera, tag, 0.5 + SHEET_RIM[1]):
                    targets.append(tag)
                    break
        else:
            raise ValueError("no tag fits this camera's picture")
    return Scene(camera, tuple(targets)), numbers


def charuco_box_scene(
    rng: np.random.Generator,
    *,
    squares: int = 8,
    ratio: float = 0.75,
    name: str = "6X6_1000",
    camera: TrueCamera | None = None,
) -> Scene:
    """Draw a box's corner, each of its three faces covered by a square ChArUco board.

    The numbers of board f begin at f M, M being the number of its light cells.
    """
    codes = dictionary(name).codes
    half = squares**2 // 2
    for _ in range(MAX_DRAWS):
        scene_camera = camera or random_camera(rng)
        faces = [
            _board(face, squares, ratio, codes[i * half : (i + 1) * half])
            for i, face in enumerate(box_faces(rng, scene_camera))
        ]
        if all(in_picture(scene_camera, face, 0.5 * squares) for face in faces):
            return Scene(scene_camera, tuple(faces))
    raise ValueError("no box fits this camera's picture")


def box_faces(rng: np.random.Generator, camera: TrueCamera) -> list[Target]:
    """Draw three faces with unit sides that meet in a corner pointing roughly at the camera."""
    width, height = camera.image_size
    while True:
        turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        inward = turned * np.where(turned[2] >= 0.0, 1.0, -1.0)  # columns: into the box
        tilts = np.degrees(np.arccos(inward[2]))
        if np.all((tilts > BOX_TILTS[0]) & (tilts < BOX_TILTS[1])):
            break
    pixel = rng.uniform(0.42, 0.58, 2) * [width, height]
    depth = camera.fx / (height * rng.uniform(0.4, 0.52))
    corner = np.append(camera.undistort(pixel[None])[0], 1.0) * depth
    faces = []
    for i in range(3):
        normal, first, second = inward[:, i], inward[:, i - 2], inward[:, i - 1]
        if np.linalg.det(np.column_stack([first, second, normal])) < 0.0:
            first, second = second, first
        centre = corner + 0.5 * (first + second)
        faces.append(Target(np.column_stack([first, second, normal]), centre))
    return faces


def _board(face: Target, squares: int, ratio: float, codes: Codes) -> Target:
    """Lay a ChArUco board over a face of unit side; its own unit is a cell."""
    cell = (1.0 - 2.0 * BOX_MARGIN) / squares
    return MarkedTarget(
        face.rotation,
        face.translation / cell,
        "chessboard",
        inner=ratio,
        inner_corners=(squares - 1, squares - 1),
        codes=codes,
    )


def in_picture(camera: TrueCamera, target: Target, half: float) -> bool:
    """Return whether a square of the target's plane stays clear of the picture's border."""
    corners = rectangle(half, half)
    fraction = np.linspace(0.0, 1.0, 9)[:, None, None]
    outline = (corners + fraction * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    points: Array = target.to_camera(outline)
    if np.any(points[:, 2] <= 0.0):
        return False
    pixels = camera.project(points)
    try:
        normalised = camera.undistort(pixels)
    except ValueError:
        return False
    # A point beyond the distortion's fold would be undistorted to another place.
    same = np.allclose(normalised, points[:, :2] / points[:, 2:], atol=1e-6)
    low, high = PICTURE_MARGIN, np.array(camera.image_size) - 1.0 - PICTURE_MARGIN
    return bool(same and np.all(pixels > low) and np.all(pixels < high))
