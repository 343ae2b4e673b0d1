"""Scenes like those that people photograph: boards in corners, on boxes and anywhere, with truth.

Three chessboards meet in the corner of a room or of a box, or hang freely; some are seen at 70
degrees, cut by the picture's border, or partly hidden by an arm; squares may be beside them. Other
scenes are three squares among many rectangles, tags, or ChArUco boards on a box.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.convex_quads import any_meet
from trisquare._support.rotations import tilted
from trisquare.simulate import random_camera
from trisquare.simulate.cramer_rao import cramer_rao_bound, pixel_sigma
from trisquare.simulate.render import WHITE, Image, quantised, render
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import faces_camera, inside
from trisquare_scenes.distractors import mixed_scene
from trisquare_scenes.occluders import Overlay, polygon_mask
from trisquare_scenes.picture_bound import picture_bound
from trisquare_scenes.tagged import charuco_box_scene, tag_scene

RealKind = Literal[
    "room corner",
    "touching boards",
    "box",
    "free boards",
    "steep board",
    "cut by the border",
    "partly hidden",
    "beside squares",
    "among rectangles",
    "tags",
    "charuco box",
]
KINDS: tuple[RealKind, ...] = get_args(RealKind)

CELLS = (4, 12)
"""Range of a board's number of cells per direction."""

CELL_PIXELS = (10.0, 40.0)
"""Range of a cell's side in the picture before foreshortening, where the boards meet or in their
middle; after it, no cell's side may be shorter than the minimum."""

STRONG_K1 = -0.2
STRONG_SHARE = 0.5
"""Distortion coefficient, and the fraction of cameras with a stronger barrel distortion: half."""

CORNER_TILT = 22.0
"""Maximum turn of a corner from the view equally into all three faces, degrees."""

RIMS = (0.3, 1.0)
"""Range of the paper's width beyond the cells, in cells."""

FREE_TILTS = (25.0, 50.0)
STEEP_TILT = 70.0
"""Range of tilts of free boards, and tilt of a steep one, degrees."""

TILT_JITTER = 20.0
"""Jitter of the otherwise evenly spread directions of tilt, degrees."""

FREE_PLACES = {
    3: ((0.24, 0.3), (0.76, 0.3), (0.5, 0.72)),
    4: ((0.25, 0.27), (0.75, 0.27), (0.25, 0.73), (0.75, 0.73)),
}
PLACE_JITTER = 0.03
SQUARE_SIDES = (0.2, 0.3)
"""Range of the side of a square beside boards, over the picture's height."""

SHOWN = (0.6, 0.95)
"""Range of the fraction of all crossings that the border, or an arm, leaves in sight."""

MIN_SHOWN = 9
"""Minimum number of crossings that each board shows."""

ARM_WIDTHS = (0.03, 0.09)
"""Range of an arm's width, over the picture's."""

SKIN = np.array([0.45, 0.62, 1.0])
SKIN_LIGHT = (0.1, 0.5)

TAG_SIDES = (150.0, 260.0)
"""Range of tags' sides before foreshortening, pixels: three smaller tags determine too little of a
camera."""

CHARUCO_CELLS = (4, 6)
"""Range of a ChArUco board's number of cells per direction."""

CHARUCO_CELL_PIXELS = 24.0
"""Minimum side of its cells in the picture, pixels: a marker's white rim, an eighth of it, is then
as wide as the two flanks of the widest blur."""

ANSWERABLE = 0.004
"""Bound of fx, cx and cy, over the width, beyond which a scene is drawn again, since it is near
those for which a calibration is rightly refused (3 % of f or 2 % of the width, four times over)."""

PINHOLE_AND_RADIAL = ("fx", "fy", "cx", "cy", "k1", "k2")

JUDGED = (*PINHOLE_AND_RADIAL, "p1", "p2")
JUDGED_NOISE = 0.2
JUDGED_LIMIT = 0.02
"""A calibration is refused where fx, fy, cx or cy has a standard deviation of 4 % of f or of the
width, with its centre of distortion freed from the principal point (to first order, `p1` and `p2`)
and noise of at least `JUDGED_NOISE` pixels per pixel of edge. All scenes are below `JUDGED_LIMIT`,
half of that."""

BOUND_SPACING = 8.0
"""Distance along an edge of the bound's samples, pixels; the sums are smooth."""

BORDER_MARGIN = 2.0
"""Minimum distance of a point in sight from the border, pixels."""

MAX_DRAWS = 20_000
"""Maximum number of scenes drawn by rejection; for some kinds one in a hundred is accepted."""


FIGURES: Mapping[str, Callable[[np.random.Generator, TrueCamera], Scene]] = {
    "among rectangles": lambda rng, camera: mixed_scene(rng, camera=camera).scene,
    "tags": lambda rng, camera: tag_scene(rng, sides=TAG_SIDES, camera=camera)[0],
    "charuco box": lambda rng, camera: _charuco_box(rng, camera),
}
"""Scenes without plain boards."""


@dataclass(frozen=True, slots=True, eq=False)
class RealPicture:
    """A rendered photograph and its truth.

    Attributes
    ----------
    picture : ndarray of uint8, shape (H, W) or (H, W, 3)
    kind : str
        One of `KINDS`.
    scene : Scene
        The targets to calibrate from, without rectangles that are not squares.
    settings : dict
        The arguments of `render`.
    ideal : ndarray of float32, shape (H, W)
        The grey picture without noise and JPEG, 0 to 255.
    """

    picture: Image
    kind: RealKind
    scene: Scene
    settings: dict[str, Any]
    ideal: npt.NDArray[np.float32]

    def in_sight(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return whether pixels, shape (N, 2), are in the picture and nothing covers them."""
        return _in_sight(self.scene.camera, self.settings["overlays"], points)

    def bound(self) -> dict[str, float]:
        """Return standard deviations of a calibration from all pixels along the edges in sight.

        Their errors are the photograph's own: the sensor's noise, which is lower in the mean of
        three colours, and JPEG's errors, with any correlation within its blocks.
        """
        wrong = _grey(self.picture.astype(np.float32)) - self.ideal
        blur = self.settings["blur"]
        return picture_bound(self.scene, self.ideal, wrong, blur, in_sight=self.in_sight)


def real_picture(
    rng: np.random.Generator, kind: RealKind, image_size: tuple[int, int] = (1280, 960)
) -> RealPicture:
    """Draw a scene of a kind and photograph it as a phone might.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    kind : str
        One of `KINDS`.
    image_size : tuple of int
        Width and height, pixels.

    Returns
    -------
    RealPicture
        JPEG of quality 60 to 95, blur 0.5 to 1.5 pixels, noise 1 to 5 and contrast 60 to 200 grey
        levels, shading, clutter, sRGB.
    """
    settings = _settings(rng)
    sigma = pixel_sigma(settings["noise"], settings["contrast"], settings["blur"])
    for _ in range(MAX_DRAWS):
        scene = _scene(rng, kind, _camera(rng, image_size))
        if scene is None:
            continue
        arms = _arms(rng, scene, settings) if kind == "partly hidden" else []
        hidden = kind in ("cut by the border", "partly hidden")
        if hidden and not _partly_shown(scene, arms):
            continue
        if _smallest_cell(scene) < CELL_PIXELS[0] or not _answerable(scene, sigma, arms):
            continue
        settings["overlays"] = arms
        return _photographed(rng, kind, scene, settings)
    raise ValueError(f"no scene of the kind {kind!r} fits")


def _photographed(
    rng: np.random.Generator, kind: RealKind, scene: Scene, settings: dict[str, Any]
) -> RealPicture:
    """Render a scene, and keep its picture without noise."""
    clean = {**settings, "noise": 0.0, "jpeg_quality": None, "dtype": np.float32}
    coded = render(scene, rng, **clean)
    ideal = np.asarray(WHITE * _grey(coded), np.float32)
    coded = coded.reshape(*coded.shape[:2], -1).astype(np.float64)
    coded += settings["noise"] / WHITE * rng.standard_normal(coded.shape)
    picture = quantised(coded, np.dtype(np.uint8), settings["jpeg_quality"])
    wanted = Scene(scene.camera, tuple(target for target in scene.targets if _is_wanted(target)))
    return RealPicture(picture, kind, wanted, settings, ideal)


def _is_wanted(target: Target) -> bool:
    return target.printed is None


def _grey(picture: Image) -> Image:
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


def _settings(rng: np.random.Generator) -> dict[str, Any]:
    """Draw the conditions of the picture."""
    return {
        "noise": rng.uniform(1.0, 5.0),
        "blur": rng.uniform(0.5, 1.5),
        "contrast": rng.uniform(60.0, 200.0),
        "tone": "srgb",
        "colour": bool(rng.random() < 0.5),
        "shading": rng.uniform(0.0, 0.4),
        "clutter": int(rng.integers(20, 80)),
        "jpeg_quality": int(rng.integers(60, 96)),
        "overlays": [],
    }


def _camera(rng: np.random.Generator, image_size: tuple[int, int]) -> TrueCamera:
    strong = rng.random() < STRONG_SHARE
    while True:
        camera = random_camera(rng, image_size)
        if not strong or camera.distortion[0] < STRONG_K1:
            return camera


def _scene(rng: np.random.Generator, kind: RealKind, camera: TrueCamera) -> Scene | None:
    """Draw the targets of a scene; None if they do not fit together."""
    if kind in FIGURES:
        try:
            return FIGURES[kind](rng, camera)
        except ValueError:  # it does not fit this camera's picture
            return None
    if kind in ("free boards", "steep board"):
        return _free(rng, camera, boards=3, squares=0, steep=kind == "steep board")
    if kind == "beside squares":
        return _free(rng, camera, boards=2, squares=2)
    if kind == "partly hidden" and rng.random() < 0.5:
        return _free(rng, camera, boards=3, squares=0)
    return _corner(
        rng,
        camera,
        convex=kind == "box" or (kind == "cut by the border" and rng.random() < 0.5),
        rim=0.0 if kind == "touching boards" else rng.uniform(*RIMS),
        whole=kind != "cut by the border",
    )


def _corner(
    rng: np.random.Generator, camera: TrueCamera, *, convex: bool, rim: float, whole: bool
) -> Scene | None:
    """Draw three boards on the faces of a room's corner or a box's, their sheets touching."""
    cells = rng.integers(CELLS[0], CELLS[1] + 1, 3)
    depth = camera.fx / rng.uniform(*CELL_PIXELS)  # in cells
    pixel = rng.uniform(0.3, 0.7, 2) * camera.image_size
    apex = np.append(camera.undistort(pixel[None])[0], 1.0) * depth
    # Edges at equal angles to the line of sight, on a box away from the camera.
    turns = rng.uniform(0.0, 360.0) + np.array([0.0, 120.0, 240.0])
    across, along = np.sqrt(2.0 / 3.0), np.sqrt(1.0 / 3.0) * (1.0 if convex else -1.0)
    even = np.stack(
        [
            across * np.cos(np.deg2rad(turns)),
            across * np.sin(np.deg2rad(turns)),
            np.full(3, along),
        ]
    )
    turned = tilted(rng.uniform(0.0, CORNER_TILT), rng.uniform(0.0, 360.0), 0.0)
    edges = turned @ even
    targets = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        centre = apex + (rim + 0.5 * cells[i]) * edges[:, i] + (rim + 0.5 * cells[j]) * edges[:, j]
        if np.cross(edges[:, i], edges[:, j]) @ centre < 0.0:
            i, j = j, i  # seen from the front
        normal = np.cross(edges[:, i], edges[:, j])
        rotation = np.column_stack([edges[:, i], edges[:, j], normal])
        if not faces_camera(rotation, centre):
            return None
        corners = (int(cells[i]) - 1, int(cells[j]) - 1)
        board = Target(rotation, centre, "chessboard", inner_corners=corners, rim=rim)
        if not (inside(camera, board) if whole else _seen_unfolded(camera, board)):
            return None
        targets.append(board)
    return Scene(camera, tuple(targets))


def _free(
    rng: np.random.Generator, camera: TrueCamera, *, boards: int, squares: int, steep: bool = False
) -> Scene | None:
    """Draw boards and squares that stand apart from each other."""
    count = boards + squares
    first = rng.uniform(0.0, 360.0)
    order = rng.permutation(count)
    targets: list[Target] = []
    for number, place in enumerate(FREE_PLACES[count]):
        pixel = (place + rng.normal(0.0, PLACE_JITTER, 2)) * camera.image_size
        ray = np.append(camera.undistort(pixel[None])[0], 1.0)
        tilt = STEEP_TILT if steep and order[number] == 0 else rng.uniform(*FREE_TILTS)
        jitter = rng.uniform(-TILT_JITTER, TILT_JITTER)
        rotation = tilted(tilt, first + 360.0 * number / count + jitter, rng.uniform(0.0, 360.0))
        if order[number] < boards:
            columns, rows = rng.integers(CELLS[0], CELLS[1] + 1, 2).tolist()
            cell = rng.uniform(*CELL_PIXELS)
            target = _facing(
                rotation,
                ray * camera.fx / cell,
                kind="chessboard",
                inner_corners=(columns - 1, rows - 1),
                rim=float(rng.uniform(*RIMS)),
            )
        else:
            side = camera.image_size[1] * rng.uniform(*SQUARE_SIDES)
            target = _facing(rotation, ray * camera.fx / side)
        if target is None or not inside(camera, target):
            return None
        targets.append(target)
    return None if _overlap(targets) else Scene(camera, tuple(targets))


def _charuco_box(rng: np.random.Generator, camera: TrueCamera) -> Scene:
    """Draw three ChArUco boards of small codes on a box, near enough for their white rims."""
    squares = int(rng.integers(CHARUCO_CELLS[0], CHARUCO_CELLS[1] + 1))
    scene = charuco_box_scene(rng, squares=squares, name="4X4_1000", camera=camera)
    if _smallest_cell(scene) < CHARUCO_CELL_PIXELS:
        raise ValueError("the cells are too small")
    return scene


def _facing(rotation: Array, centre: Array, **options: Any) -> Target | None:
    return Target(rotation, centre, **options) if faces_camera(rotation, centre) else None


def _seen_unfolded(camera: TrueCamera, target: Target) -> bool:
    """Return whether a board, which may leave the picture, is ahead and within the lens's range."""
    fractions = np.linspace(-1.0, 1.0, 9)
    u, v = (grid.ravel() for grid in np.meshgrid(fractions, fractions))
    points = target.to_camera(np.stack([u, v], axis=1) * (np.array(target.extent) + target.rim))
    if np.any(points[:, 2] <= 0.0):
        return False
    normalised = points[:, :2] / points[:, 2:]
    k1, k2, _, _, k3 = camera.distortion
    r2 = np.sum(normalised**2, axis=1)
    return bool(np.all(1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) > 0.2))


def _overlap(targets: list[Target]) -> bool:
    """Return whether the sheets of two targets meet in the picture."""
    quads = []
    for target in targets:
        rim = 0.15 if target.rim is None else target.rim
        points = target.to_camera(rectangle(*(np.array(target.extent) + rim)))
        if np.any(points[:, 2] <= 0.0):
            return True
        quads.append(points[:, :2] / points[:, 2:])
    return any_meet(quads)


def _arms(rng: np.random.Generator, scene: Scene, settings: dict[str, Any]) -> list[Overlay]:
    """Draw one or two arms that reach from beyond the border over a board."""
    size = scene.camera.image_size
    arms = []
    for _ in range(int(rng.integers(1, 3))):
        target = int(rng.integers(len(scene.targets)))
        crossings = scene.image_points(target, scene.targets[target].board_corners())
        tip = crossings[rng.integers(len(crossings))]
        outward = tip - 0.5 * np.array(size) + rng.normal(0.0, 0.1 * size[0], 2)
        outward /= np.hypot(*outward)
        half = 0.5 * size[0] * rng.uniform(*ARM_WIDTHS)
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 25)[:, None]
        across = np.array([-outward[1], outward[0]])
        round_tip = tip + half * (np.sin(angle) * across - np.cos(angle) * outward)
        reach = 2.0 * max(size) * outward
        outline = np.concatenate([round_tip, [round_tip[-1] + reach, round_tip[0] + reach]])
        light = rng.uniform(*SKIN_LIGHT) * (SKIN if settings["colour"] else np.array([SKIN.mean()]))
        arms.append(Overlay(polygon_mask(outline, size, settings["blur"]), 1.0, light))
    return arms


def _in_sight(camera: TrueCamera, overlays: list[Overlay], points: Array) -> npt.NDArray[np.bool_]:
    low, high = BORDER_MARGIN, np.array(camera.image_size) - 1.0 - BORDER_MARGIN
    is_inside = np.all((points > low) & (points < high), axis=1)
    x, y = np.rint(points[is_inside]).astype(int).T
    for overlay in overlays:
        covered = np.zeros(len(points), bool)
        covered[np.flatnonzero(is_inside)] = overlay.mask[y, x] > 0.0
        is_inside &= ~covered
        x, y = np.rint(points[is_inside]).astype(int).T
    return np.asarray(is_inside)


def _partly_shown(scene: Scene, overlays: list[Overlay]) -> bool:
    """Return whether some of all crossings are out of sight, but each board shows enough."""
    shown = []
    for number, target in enumerate(scene.targets):
        crossings = scene.image_points(number, target.board_corners())
        shown.append(_in_sight(scene.camera, overlays, crossings))
    share = float(np.concatenate(shown).mean())
    return SHOWN[0] <= share <= SHOWN[1] and min(part.sum() for part in shown) >= MIN_SHOWN


def _smallest_cell(scene: Scene) -> float:
    """Return the length of the shortest side of any board's cell, pixels."""
    shortest = [np.inf]
    for number, target in enumerate(scene.targets):
        if target.is_board:
            columns, rows = target.inner_corners
            grid = scene.image_points(number, target.board_corners()).reshape(rows, columns, 2)
            shortest += [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    return float(min(shortest))


def _bound(
    scene: Scene, sigma: float, overlays: list[Overlay], free: Sequence[str] = PINHOLE_AND_RADIAL
) -> dict[str, float]:
    return cramer_rao_bound(
        scene,
        sigma / np.sqrt(BOUND_SPACING),
        spacing=BOUND_SPACING,
        free=free,
        in_sight=lambda points: _in_sight(scene.camera, overlays, points),
    )


def _answerable(scene: Scene, sigma: float, overlays: list[Overlay]) -> bool:
    """Return whether the parts in sight determine the camera well enough for a calibration."""
    scene = Scene(scene.camera, tuple(target for target in scene.targets if _is_wanted(target)))
    width = scene.camera.image_size[0]
    try:
        bound = _bound(scene, sigma, overlays)
        if max(bound[name] for name in ("fx", "cx", "cy")) >= ANSWERABLE * width:
            return False
        judged = _bound(scene, max(sigma, JUDGED_NOISE), overlays, JUDGED)
    except ValueError:
        return False
    units = {"fx": scene.camera.fx, "fy": scene.camera.fy, "cx": width, "cy": width}
    return max(judged[name] / unit for name, unit in units.items()) < JUDGED_LIMIT
