"""The printed corner, folded, as it is photographed: three planes at right angles."""

from __future__ import annotations

from typing import Any

import numpy as np

from trisquare._support.rotations import tilted
from trisquare.printing.folding import FOLDS, LOOK_ALONG_DIAGONAL
from trisquare.printing.layout import PrintedBoard, TargetPage, corner_page
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import MAX_DRAWS, placed, random_camera

# Maximum angle between the direction of view and the corner's diagonal; at 20 degrees, one of the
# faces is tilted by 75 and the two others by 50 at most.
OFF_DIAGONAL = 15.0  # degrees
# Distance over the smallest at which the corner fits, and its offset from the picture's middle.
DISTANCE = (1.02, 1.2)
JITTER = 0.02  # of the picture's height
CENTRING_STEPS = 3  # each leaves half; after three, under 10 px, less than the jitter
NEARER = 0.95  # factor by which a camera approaches while it sees the whole corner


def folded_frames(page: TargetPage) -> list[tuple[Array, Array]]:
    """Return ``corner_from_plane`` of a page's frames, folded with the print inside, millimetres.

    The corner's frame has its origin at the apex, x and y right and down in the sheet's upper
    left face, z into that face; the frames' planes are on its negative axes. A plane's origin is
    the frame's centre, its axes right, down and into the paper.

    Raises
    ------
    ValueError
        If the page is a flat one.
    """
    if page.apex is None:
        raise ValueError("a flat page has no corner: ask for printed_target('corner')")
    return [
        (turn, turn @ np.append(np.subtract(frame.centre, page.apex), 0.0))
        for frame, turn in zip(page.frames, FOLDS, strict=True)
    ]


def corner_scene(
    rng: np.random.Generator,
    *,
    page: TargetPage | None = None,
    image_size: tuple[int, int] = (1280, 960),
    camera: TrueCamera | None = None,
) -> Scene:
    """Draw a photograph of the printed corner: three figures on planes at right angles.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all random numbers.
    page : TargetPage, optional
        The corner's page of a `printed_target`; by default that of A4.
    image_size : tuple of int
        Width and height, pixels; those of `camera` if that is given.
    camera : TrueCamera, optional
        The camera; drawn if not given.

    Returns
    -------
    Scene
        Seen from within 15 degrees of its diagonal, at any rotation about that, nearly filling the
        picture. The targets are in the order of the page's figures, with the paper's margin as rim.
    """
    sheet = corner_page("A4", None) if page is None else page
    camera = camera or random_camera(rng, image_size)
    for _ in range(MAX_DRAWS):
        off = OFF_DIAGONAL * np.sqrt(rng.random())
        turned = tilted(off, rng.uniform(0.0, 360.0), rng.uniform(0.0, 360.0))
        jitter = JITTER * camera.image_size[1] / camera.fx * rng.standard_normal(2)
        # From a distance at which the corner is surely seen whole to the smallest such distance.
        distance, nearest = 8.0 * sheet.face * camera.fx / min(camera.image_size), None
        while _seen_corner(camera, sheet, turned, distance, jitter) is not None:
            distance, nearest = NEARER * distance, distance
        if nearest is None:
            continue
        distance = nearest * rng.uniform(*DISTANCE)
        targets = _seen_corner(camera, sheet, turned, distance, jitter)
        if targets is not None:
            return Scene(camera, targets)
    raise ValueError("the corner does not fit this camera's picture")


def _seen_corner(
    camera: TrueCamera, page: TargetPage, turned: Array, distance: float, jitter: Array
) -> tuple[Target, ...] | None:
    """Place a folded corner `distance` millimetres away; None if it is not seen whole."""
    cam_from_corner = turned @ LOOK_ALONG_DIAGONAL
    poses = folded_frames(page)
    rotations = [cam_from_corner @ rotation for rotation, _ in poses]
    centres = np.array([cam_from_corner @ translation for _, translation in poses])
    centres += [0.0, 0.0, distance] - centres.mean(axis=0)
    for _ in range(CENTRING_STEPS):
        outlines = [
            centre + frame.side * rectangle(0.5, 0.5) @ rotation[:, :2].T
            for frame, rotation, centre in zip(page.frames, rotations, centres, strict=True)
        ]
        points = np.concatenate(outlines)
        if np.any(points[:, 2] <= 0.0):
            return None
        seen = points[:, :2] / points[:, 2:]
        centres[:, :2] -= distance * (0.5 * (seen.min(axis=0) + seen.max(axis=0)) - jitter)
    targets = []
    for figure, rotation, centre in zip(page.frames, rotations, centres, strict=True):
        if isinstance(figure, PrintedBoard):
            unit, inner = figure.side / figure.cells, (figure.cells - 1, figure.cells - 1)
            options: dict[str, Any] = {"kind": "chessboard", "inner_corners": inner}
        else:
            unit, options = figure.side, {"kind": "frame", "inner": figure.inner}
        rim = 0.5 * (page.face - figure.side) / unit
        target = placed(camera, rotation, centre / unit, rim=rim, **options)
        if target is None:
            return None
        targets.append(target)
    return tuple(targets)
