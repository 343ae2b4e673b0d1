"""Seeded cameras, scenes of squares and of boards, and their edge points, with known truth."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from trisquare._support.convex_quads import any_meet
from trisquare._support.rotations import tilted
from trisquare.simulate.render import SHEET_RIM, Image, render
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle, sample_sides

# The distribution that docs/how-exact.md states.
FOCAL_RANGE = (0.65, 1.3)  # of the width
ASPECT_RANGE = 0.005
PRINCIPAL_POINT_STD = 0.012  # of the width
K1_RANGE = (-0.32, 0.12)
K2_RANGE = (0.0, 0.35)  # of |k1|
TILT_RANGE = (25.0, 50.0)  # degrees
TILT_DIRECTION_JITTER = 20.0  # degrees
SIDE_RANGE = (0.30, 0.42)  # of the height
CENTRE_JITTER = 0.015  # of the picture

# Centres of the squares by their number, as fractions of the picture.
PLACES = {
    1: [(0.5, 0.5)],
    2: [(0.27, 0.5), (0.73, 0.5)],
    3: [(0.23, 0.3), (0.77, 0.3), (0.5, 0.72)],
}
PICTURE_MARGIN = 12.0  # pixels between any square and the border
# Maximum angle between a plane's normal and its line of sight: beyond, its sides merge under blur.
STEEPEST_SIGHT = 75.0  # degrees
# Scenes are drawn by rejection; one in a few is accepted, so this is never reached by chance.
MAX_DRAWS = 5000


def random_camera(
    rng: np.random.Generator, image_size: tuple[int, int] = (1280, 960)
) -> TrueCamera:
    """Draw a camera whose distortion is monotonic over the whole picture."""
    width, height = image_size
    fx = width * rng.uniform(*FOCAL_RANGE)
    fy = fx * (1.0 + rng.uniform(-ASPECT_RANGE, ASPECT_RANGE))
    cx, cy = rng.normal([0.5 * (width - 1), 0.5 * (height - 1)], PRINCIPAL_POINT_STD * width)
    for _ in range(MAX_DRAWS):
        k1 = rng.uniform(*K1_RANGE)
        k2 = abs(k1) * rng.uniform(*K2_RANGE)
        camera = TrueCamera(fx, fy, cx, cy, np.array([k1, k2, 0.0, 0.0, 0.0]), image_size)
        if camera.is_monotonic():
            return camera
    raise ValueError("no distortion is monotonic over this picture")


def random_scene(
    rng: np.random.Generator,
    *,
    image_size: tuple[int, int] = (1280, 960),
    kind: Literal["square", "frame"] = "square",
    count: int = 3,
    camera: TrueCamera | None = None,
    dark: bool = True,
    inner: float = 0.6,
    aspect: float = 1.0,
    rim: float | None = None,
    sides: tuple[float, float] | None = None,
    tilts: tuple[float, float] = TILT_RANGE,
) -> Scene:
    """Draw a scene of tilted squares, all inside the picture and clear of one another.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    image_size : tuple of int
        Width and height, pixels; those of `camera` if that is given.
    kind : {"square", "frame"}
        Solid squares or frames.
    count : int
        Number of squares. Beyond three they shrink so that they fit, unless `sides` is given.
    camera : TrueCamera, optional
        The camera; drawn if not given.
    dark : bool
        Dark figures on light ground, or the reverse.
    inner : float
        Side of a frame's hole, in units of its outer side.
    aspect : float
        Side 0 of every figure over its side 1, 1 or more: rectangles with the area of squares.
    rim : float, optional
        As for `Target`.
    sides : (float, float), optional
        Range of the sides before foreshortening, over the picture's height; 0.30 to 0.42 by
        default.
    tilts : (float, float)
        Range of the angles between the squares' planes and the picture, degrees.

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        If no such scene fits the picture.
    """
    printed = None if aspect == 1.0 else rectangle(0.5 * aspect, 0.5)
    camera = camera or random_camera(rng, image_size)
    image_size = camera.image_size
    places = _places(count)
    if sides is None:
        shrink = min(1.0, np.sqrt(3.0 / count))
        sides = (shrink * SIDE_RANGE[0], shrink * SIDE_RANGE[1])
    for _ in range(MAX_DRAWS):
        first = rng.uniform(0.0, 360.0)
        targets: list[Target] = []
        for i, place in enumerate(places):
            pixel = (place + rng.normal(0.0, CENTRE_JITTER, 2)) * image_size
            side = image_size[1] * rng.uniform(*sides)
            jitter = rng.uniform(-TILT_DIRECTION_JITTER, TILT_DIRECTION_JITTER)
            rotation = tilted(
                rng.uniform(*tilts),
                first + 360.0 * i / count + jitter,
                rng.uniform(0.0, 360.0),
            )
            # The side has this length before foreshortening.
            depth = camera.fx / side * np.sqrt(aspect)
            centre = np.append(camera.undistort(pixel[None])[0], 1.0) * depth
            target = placed(
                camera,
                rotation,
                centre,
                kind=kind,
                dark=dark,
                inner=inner,
                printed=printed,
                rim=rim,
            )
            if target is None:
                break
            targets.append(target)
        if len(targets) == count and not _any_overlap(targets):
            return Scene(camera, tuple(targets))
    raise ValueError(f"no {count} squares fit this camera's picture")


def chessboard_scene(
    rng: np.random.Generator, camera: TrueCamera, inner_corners: tuple[int, int] = (9, 6)
) -> Scene:
    """Draw one picture of a chessboard session: one tilted board, well inside the picture."""
    width, height = camera.image_size
    for _ in range(MAX_DRAWS):
        rotation = tilted(rng.uniform(5.0, 45.0), rng.uniform(0.0, 360.0), rng.uniform(-20.0, 20.0))
        pixel = rng.uniform(0.25, 0.75, 2) * [width, height]
        cell = rng.uniform(0.45, 0.85) * width / (inner_corners[0] + 1)
        depth = camera.fx / cell
        centre = np.append(camera.undistort(pixel[None])[0], 1.0) * depth
        board = placed(camera, rotation, centre, kind="chessboard", inner_corners=inner_corners)
        if board is not None:
            return Scene(camera, (board,))
    raise ValueError("no board fits this camera's picture")


def photo_like(
    rng: np.random.Generator, image_size: tuple[int, int] = (1280, 960)
) -> tuple[Image, Scene, dict[str, Any]]:
    """Draw a scene and render it as a phone might: sRGB, clutter, shading, colour.

    Returns
    -------
    picture : ndarray of uint8, shape (H, W, 3)
        BGR.
    scene : Scene
        The truth of the picture.
    settings : dict
        The keyword arguments of `render`.
    """
    kind: Literal["square", "frame"] = "frame" if rng.random() < 0.5 else "square"
    return _photographed(rng, random_scene(rng, image_size=image_size, kind=kind))


def photo_of_sheets(
    rng: np.random.Generator,
    aspect: float = 2.0**0.5,
    *,
    dark: bool = False,
    rim: float | None = 0.0,
    camera: TrueCamera | None = None,
) -> tuple[Image, Scene, dict[str, Any]]:
    """Draw three sheets of paper that lie directly on the clutter, rendered as by `photo_like`.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    aspect, dark, rim, camera
        As for `random_scene`; with a rim, or None for a random one, they are rectangles on
        larger sheets.

    Returns
    -------
    picture, scene, settings
        As from `photo_like`.
    """
    scene = random_scene(rng, dark=dark, aspect=aspect, rim=rim, camera=camera)
    return _photographed(rng, scene)


def _photographed(rng: np.random.Generator, scene: Scene) -> tuple[Image, Scene, dict[str, Any]]:
    settings: dict[str, Any] = {
        "noise": rng.uniform(1.0, 4.0),
        "blur": rng.uniform(0.5, 1.2),
        "contrast": rng.uniform(130.0, 200.0),
        "tone": "srgb",
        "colour": True,
        "shading": rng.uniform(0.0, 0.4),
        "clutter": int(rng.integers(20, 80)),
    }
    return render(scene, rng, **settings), scene, settings


def edge_points(
    scene: Scene, rng: np.random.Generator, *, noise: float, spacing: float = 4.0
) -> list[list[Array]]:
    """Sample the edges of a scene's targets with noise along their normals.

    Parameters
    ----------
    scene : Scene
        Squares, frames or chessboards.
    rng : numpy.random.Generator
        Source of the noise.
    noise : float
        Standard deviation of each point along its edge's normal, pixels.
    spacing : float
        Distance between neighbours along the edge, pixels.

    Returns
    -------
    list of list of ndarray, each shape (N, 2)
        Per target, the points of its four sides, in order; a frame's hole adds four more. For a
        chessboard those of its rows, then its columns, between the outermost crossings.
    """
    return [
        [
            side.image + noise * rng.standard_normal((len(side.plane), 1)) * side.normal
            for side in sample_sides(scene.camera, target, spacing)
        ]
        for target in scene.targets
    ]


def _places(count: int) -> Array:
    """Return the squares' centres, as fractions of the picture, shape (count, 2)."""
    if count in PLACES:
        return np.array(PLACES[count])
    columns = int(np.ceil(np.sqrt(4.0 / 3.0 * count)))
    rows = -(-count // columns)
    grid = [((i % columns + 0.5) / columns, (i // columns + 0.5) / rows) for i in range(count)]
    return np.array(grid)


def placed(camera: TrueCamera, rotation: Array, centre: Array, **options: Any) -> Target | None:
    """Make a target; None if it is seen too steeply or not wholly in the picture."""
    if not faces_camera(rotation, centre):
        return None
    target = Target(rotation, centre, **options)
    return target if inside(camera, target) else None


def faces_camera(rotation: Array, centre: Array) -> bool:
    """Return whether a plane is seen from its front and not too nearly edge-on."""
    cosine = rotation[:, 2] @ centre / np.linalg.norm(centre)
    return bool(cosine > np.cos(np.deg2rad(STEEPEST_SIGHT)))


def inside(camera: TrueCamera, target: Target) -> bool:
    """Return whether the figure, with its curved sides, stays clear of the picture's border."""
    corners = rectangle(*target.extent)
    fraction = np.linspace(0.0, 1.0, 9)[:, None, None]
    outline = corners + fraction * (np.roll(corners, -1, axis=0) - corners)
    points = target.to_camera(outline.reshape(-1, 2))
    # The distortion must grow up to there, or it might fold the points back into the picture.
    if not np.all(camera.sees(points)):
        return False
    pixels = camera.project(points)
    low, high = PICTURE_MARGIN, np.array(camera.image_size) - 1.0 - PICTURE_MARGIN
    return bool(np.all(pixels > low) and np.all(pixels < high))


def _any_overlap(targets: list[Target]) -> bool:
    """Return whether two squares' paper sheets meet in the picture.

    Distortion is one to one, so that it suffices to test the ideal picture.
    """
    spaces = []
    for target in targets:
        rim = SHEET_RIM[1] if target.rim is None else target.rim
        spaces.append(target.to_camera(rectangle(*(extent + rim for extent in target.extent))))
    if any(np.any(points[:, 2] <= 0.0) for points in spaces):
        return True
    return any_meet([points[:, :2] / points[:, 2:] for points in spaces])
