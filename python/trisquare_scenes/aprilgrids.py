"""Seeded scenes of Kalibr AprilGrids, and photographs of them.

`trisquare.simulate.render` renders the scenes exactly, but in ten seconds: each run of bits is a
quadrilateral of its own. `ink` approximates what each part of a pixel shows by a rectangle along
the grid with the same middle and extents. That takes two seconds, and moves measured edges by 0.001
px. All edges of one direction are moved alike, which may move a camera as much as noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.interpolate import RegularGridInterpolator

from trisquare._support.rotations import tilted
from trisquare.detection.tags.codes import dictionary
from trisquare.detection.tags.decode import WIDE_BORDER
from trisquare.detection.tags.families import WIDE_BORDERED
from trisquare.simulate import random_camera
from trisquare.simulate.render import (
    WHITE,
    Image,
    ToneCurve,
    encode_tone,
    light_levels,
    quantised,
    render,
)
from trisquare.simulate.scene import (
    Array,
    Scene,
    Side,
    Target,
    TrueCamera,
    rectangle,
    sides_of,
)
from trisquare_scenes.tagged import BOX_MARGIN, MAX_DRAWS, PLACES, box_faces, in_picture, marker

SAMPLES = 4
"""Number of parts of a pixel's side."""

POSE_TILTS = (25.0, 50.0)  # degrees
POSE_WIDTHS = (0.38, 0.5)
"""Range of the side of a grid in a pose of its own, over the picture's height, before
foreshortening."""


@dataclass(frozen=True, slots=True, eq=False)
class AprilGridTarget(Target):
    """A grid of tags with borders of two cells, and dark squares between their corners.

    The plane's unit is a tag's side. Tags are numbered row by row from the bottom left.

    Parameters
    ----------
    shape : tuple of int
        Tags across and down.
    gap : float
        Width between tags, and side of the dark squares.
    first : int
        Number of the bottom left tag.
    """

    shape: tuple[int, int] = (6, 6)
    gap: float = 0.3
    first: int = 0

    @property
    def extent(self) -> tuple[float, float]:
        """Half width and half height, including the outermost dark squares, in tags' sides."""
        cols, rows = self.shape
        half = [0.5 * (count * (1.0 + self.gap) + self.gap) for count in (cols, rows)]
        return half[0], half[1]

    def tags(self) -> Iterator[tuple[int, Array]]:
        """Yield the numbers and the middles of the tags."""
        cols, rows = self.shape
        for index in range(cols * rows):
            row, column = divmod(index, cols)
            place = np.array([column - 0.5 * (cols - 1), 0.5 * (rows - 1) - row])
            yield self.first + index, place * (1.0 + self.gap)

    def figure(self) -> Iterator[tuple[float, list[Side]]]:
        """Yield the signs and the sides of convex quadrilaterals whose sum is the figure."""
        codes = dictionary(WIDE_BORDERED).codes
        for number, middle in self.tags():
            yield from marker(codes[number], middle, 1.0, WIDE_BORDER)
        cols, rows = self.shape
        for row in range(rows + 1):
            for column in range(cols + 1):
                place = np.array([column - 0.5 * cols, row - 0.5 * rows]) * (1.0 + self.gap)
                yield 1.0, sides_of(place + self.gap * rectangle(0.5, 0.5))

    def bitmap(self) -> npt.NDArray[np.bool_]:
        """Return which cells are dark: a row and a column for each gap and each cell of a tag."""
        codes = dictionary(WIDE_BORDERED).codes
        cells = codes.shape[1] + 2 * WIDE_BORDER
        cols, rows = self.shape
        dark = np.zeros((rows * (cells + 1) + 1, cols * (cells + 1) + 1), bool)
        dark[:: cells + 1, :: cells + 1] = True
        for index in range(cols * rows):
            y, x = 1 + (cells + 1) * np.array([rows - 1 - index // cols, index % cols])
            tag = np.pad(codes[self.first + index], WIDE_BORDER)
            dark[y : y + cells, x : x + cells] = ~tag
        return dark

    def sides(self) -> list[Side]:
        """Return the sides of the tags' borders."""
        unit = rectangle(0.5, 0.5)
        return [side for _, middle in self.tags() for side in sides_of(middle + unit)]


def aprilgrid_box_scene(
    rng: np.random.Generator,
    shape: tuple[int, int] = (6, 6),
    *,
    gap: float = 0.3,
    camera: TrueCamera | None = None,
) -> Scene:
    """Draw a box's corner with a grid on each of its faces; the numbers of grid f begin at f M."""
    half = AprilGridTarget(np.eye(3), np.array([0.0, 0.0, 1.0]), shape=shape, gap=gap).extent
    unit = (1.0 - 2.0 * BOX_MARGIN) / (2.0 * max(half))
    for _ in range(MAX_DRAWS):
        scene_camera = camera or random_camera(rng)
        faces = [
            AprilGridTarget(
                face.rotation,
                face.translation / unit,
                shape=shape,
                gap=gap,
                first=index * shape[0] * shape[1],
            )
            for index, face in enumerate(box_faces(rng, scene_camera))
        ]
        if all(in_picture(scene_camera, face, max(half)) for face in faces):
            return Scene(scene_camera, tuple(faces))
    raise ValueError("no box fits this camera's picture")


def aprilgrid_poses_scene(
    rng: np.random.Generator,
    shape: tuple[int, int] = (6, 6),
    *,
    gap: float = 0.3,
    widths: tuple[float, float] = POSE_WIDTHS,
    camera: TrueCamera | None = None,
) -> Scene:
    """Draw three separate copies of one grid, all numbered from 0, in three poses."""
    camera = camera or random_camera(rng)
    half = max(AprilGridTarget(np.eye(3), np.array([0.0, 0.0, 1.0]), shape=shape, gap=gap).extent)
    first, upright = rng.uniform(0.0, 360.0, 2)
    targets: list[Target] = []
    for i, place in enumerate(PLACES):
        for _ in range(MAX_DRAWS):
            rotation = tilted(
                rng.uniform(*POSE_TILTS),
                first + 120.0 * i + rng.uniform(-20.0, 20.0),
                upright + rng.uniform(-15.0, 15.0),
            )
            middle = (place + rng.uniform(-0.06, 0.06, 2)) * camera.image_size
            centre = np.append(camera.undistort(middle[None])[0], 1.0)
            centre *= camera.fx * 2.0 * half / (rng.uniform(*widths) * camera.image_size[1])
            if rotation[:, 2] @ centre <= 0.5 * np.linalg.norm(centre):
                continue
            target = AprilGridTarget(rotation, centre, shape=shape, gap=gap)
            if in_picture(camera, target, half) and not any(
                _overlap(camera, target, other, half) for other in targets
            ):
                targets.append(target)
                break
        else:
            raise ValueError("no grid fits this camera's picture")
    return Scene(camera, tuple(targets))


def _overlap(camera: TrueCamera, one: Target, two: Target, half: float) -> bool:
    """Return whether two sheets' images meet: no side of one has all of the other beyond it."""
    quads = [camera.project(target.to_camera(rectangle(half, half))) for target in (one, two)]
    for quad, other in (quads, quads[::-1]):
        along = np.roll(quad, -1, axis=0) - quad
        offsets = other[None] - quad[:, None]
        is_inside = along[:, None, 0] * offsets[..., 1] - along[:, None, 1] * offsets[..., 0]
        if (is_inside < 0.0).all(axis=1).any():
            return False
    return True


def ink(scene: Scene, blur: float) -> Array:
    """Return the dark fraction of each pixel, shape (H, W), blurred by `blur` pixels."""
    width, height = scene.camera.image_size
    covered = np.zeros((height, width))
    for target in scene.targets:
        assert isinstance(target, AprilGridTarget)
        outline = scene.camera.project(target.to_camera(rectangle(*target.extent)))
        reach = int(np.ceil(6.0 * blur)) + 20
        left, top = np.maximum(np.floor(outline.min(axis=0)).astype(int) - reach, 0).tolist()
        right, bottom = np.ceil(outline.max(axis=0)).astype(int) + reach
        y, x = np.mgrid[top : min(bottom, height), left : min(right, width)].astype(np.float64)
        rays = scene.camera.undistort(np.stack([x.ravel(), y.ravel()], axis=1))
        axes = np.column_stack([target.rotation[:, :2], target.translation])
        plane = np.linalg.solve(axes, np.column_stack([rays, np.ones(len(rays))]).T)
        places = (plane[:2] / plane[2]).reshape(2, *x.shape)
        part = covered[top : top + x.shape[0], left : left + x.shape[1]]
        part += _sampled(target, places, blur)
    return covered


def _sampled(target: AprilGridTarget, places: Array, blur: float) -> Array:
    """Return the blurred fraction of ink in pixels that show places of the grid, (2, H, W)."""
    down, across = (np.gradient(places, axis=axis) / SAMPLES for axis in (1, 2))
    reach = 0.5 * np.hypot(down, across)
    offsets = np.arange(SAMPLES) - 0.5 * (SAMPLES - 1)
    _, height, width = places.shape
    fine = np.zeros((height, SAMPLES, width, SAMPLES), np.float32)
    ink_up_to = _integral(target)
    for i, dy in enumerate(offsets):
        for j, dx in enumerate(offsets):
            middles = places + dy * down + dx * across
            (left, top), (right, bottom) = middles - reach, middles + reach
            ink = ink_up_to(right, bottom) - ink_up_to(left, bottom)
            ink += ink_up_to(left, top) - ink_up_to(right, top)
            fine[:, i, :, j] = ink / (4.0 * reach[0] * reach[1])
    whole = fine.reshape(height * SAMPLES, width * SAMPLES)
    blurred = cv2.GaussianBlur(whole, (0, 0), blur * SAMPLES)
    return np.asarray(blurred.reshape(fine.shape).mean(axis=(1, 3), dtype=np.float64))


def _integral(target: AprilGridTarget) -> Callable[[Array, Array], Array]:
    """Return a function that computes the area of ink to the left of and above a place, exactly."""
    bitmap = target.bitmap()
    cells = (len(bitmap) - 1) // target.shape[1] - 1
    borders = []
    for count, half in zip(target.shape, target.extent, strict=True):
        widths = [*[target.gap, *[1.0 / cells] * cells] * count, target.gap]
        borders.append(np.concatenate([[0.0], np.cumsum(widths)]) - half)
    x, y = borders
    area = np.pad(bitmap * np.diff(y)[:, None] * np.diff(x), ((1, 0), (1, 0)))
    within = RegularGridInterpolator((y, x), area.cumsum(axis=0).cumsum(axis=1))
    return lambda right, bottom: within((np.clip(bottom, y[0], y[-1]), np.clip(right, x[0], x[-1])))


def photograph(
    scene: Scene,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    blur: float = 0.8,
    contrast: float = 175.0,
    tone: ToneCurve = "linear",
    jpeg_quality: int | None = None,
    exact: bool = False,
) -> tuple[Image, npt.NDArray[np.float32]]:
    """Photograph grids as `simulate.render` does; return the picture, and that without noise."""
    if exact:
        coded = render(
            scene, rng, noise=0.0, blur=blur, contrast=contrast, tone=tone, dtype=np.float32
        )
    else:
        dark, light = light_levels(contrast, tone)
        coded = encode_tone(light + (dark - light) * ink(scene, blur), tone)
    noisy = coded + noise / WHITE * rng.standard_normal(coded.shape)
    picture = quantised(noisy[..., None], np.dtype(np.uint8), jpeg_quality)
    return picture, (WHITE * coded).astype(np.float32)
