"""Simulated scenes with one property varied at a time, and every estimator's error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from accuracy.planned_scenes import edges_of
from experiments.estimators import (
    BLUR,
    CONTRAST,
    Error,
    error_of,
    zhang_boards,
    zhang_corners,
)

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import TrueCamera
from trisquare.simulate.scenes import PRINCIPAL_POINT_STD

SEED = 16
SPACING = 4.0  # pixels of edge per edge point
IMAGE_SIZE = (1280, 960)
FOCAL = 1100.0  # pixels, of all sweeps except that of the field of view
K1, K2 = -0.15, 0.03  # at that focal length
FIELD = 60.4  # degrees, the horizontal field of view at that focal length

MAX_GREY = 21.0
"""Maximum noise in grey levels: with more, pictures of that contrast would be clipped."""


class Setting(NamedTuple):
    """One kind of scene.

    `noise` is that of an edge point, in pixels. `side`, as a fraction of the picture's height, and
    `tilt`, in degrees, are drawn as usual where absent. `field` is the horizontal field of view, in
    degrees.
    """

    noise: float = 0.01
    count: int = 3
    side: float | None = None
    tilt: float | None = None
    field: float = FIELD

    @property
    def grey(self) -> float:
        """Noise of a picture that determines an edge as well as the edge points, in grey levels."""
        of_one_level = simulate.pixel_sigma(1.0, CONTRAST, BLUR)
        return self.noise * np.sqrt(SPACING) / of_one_level


BASE = Setting()


@dataclass(frozen=True, slots=True)
class Sweep:
    """A property of scenes and its levels."""

    name: str  # of the field of `Setting`
    axis: str
    levels: tuple[float, ...]
    base: Setting = BASE
    logarithmic: bool = False
    boards: bool = False  # whether the boards' photographs vary with it

    def setting(self, level: int) -> Setting:
        """Return the kind of scene of a level, by its index."""
        return self.base._replace(**{self.name: self.levels[level]})


SWEEPS = (
    Sweep(
        "noise",
        "noise of an edge point, px",
        (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
        logarithmic=True,
        boards=True,
    ),
    Sweep("count", "number of squares", (3, 4, 6, 9, 12), BASE._replace(side=0.2)),
    Sweep("side", "side of a square, of the picture's height", (0.1, 0.15, 0.2, 0.3, 0.4)),
    Sweep("tilt", "tilt of the squares, degrees", (5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)),
    Sweep(
        "field",
        "horizontal field of view, degrees",
        (20.0, 30.0, 45.0, 60.0, 80.0, 100.0),
        boards=True,
    ),
)


class Job(NamedTuple):
    """One scene, and which estimators are measured on it."""

    sweep: int
    level: int
    number: int
    picture: bool
    boards: bool


def errors_of(job: Job) -> dict[str, Error]:
    """Return the error of every estimator on one scene.

    Scenes with the same number have the same draws at every level, so that levels differ, as far as
    possible, by the property only.
    """
    setting = SWEEPS[job.sweep].setting(job.level)
    rng = np.random.default_rng([SEED, job.number])
    noise = np.random.default_rng([SEED, job.number, job.sweep, job.level])
    camera = true_camera(rng, setting.field)
    tilts = {} if setting.tilt is None else {"tilts": (setting.tilt, setting.tilt)}
    sides = {} if setting.side is None else {"sides": (setting.side, setting.side)}
    scene = simulate.random_scene(rng, camera=camera, count=setting.count, **tilts, **sides)
    edges = edges_of(scene, noise, setting.noise, SPACING)
    size = camera.image_size
    estimates: dict[str, Callable[[], object]] = {
        "linear": lambda: ts.calibrate_edges(edges, size, method="linear"),
        "edges": lambda: ts.calibrate_edges(edges, size),
    }
    if setting.grey < MAX_GREY:
        photo = {"noise": setting.grey, "blur": BLUR}
        if job.picture:
            picture = simulate.render(scene, noise, contrast=CONTRAST, tone="linear", **photo)
            estimates["pixels"] = lambda: ts.calibrate(picture, tone="linear")
            estimates["corners"] = lambda: zhang_corners(picture, scene, noise)
        if job.boards:
            estimates["boards"] = lambda: zhang_boards(camera, noise, photo)
    return {name: error_of(estimate, camera) for name, estimate in estimates.items()}


def true_camera(rng: np.random.Generator, field: float) -> TrueCamera:
    """Draw the principal point of a camera with a horizontal field of view in degrees.

    The distortion bends the picture equally at every field of view: k1 and k2 change with the focal
    length.
    """
    width, height = IMAGE_SIZE
    focal = 0.5 * width / np.tan(np.deg2rad(0.5 * field))
    centre = rng.normal([0.5 * (width - 1), 0.5 * (height - 1)], PRINCIPAL_POINT_STD * width)
    ratio = (focal / FOCAL) ** 2
    distortion = np.array([ratio * K1, ratio**2 * K2, 0.0, 0.0, 0.0])
    return replace(TrueCamera(focal, focal, *centre, distortion), image_size=IMAGE_SIZE)


def true_k1(setting: Setting) -> float:
    """Return k1 of the cameras for a kind of scene."""
    return float(true_camera(np.random.default_rng(0), setting.field).distortion[0])
