"""A fisheye lens, and squares in front of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from trisquare._support.rotations import tilted
from trisquare.simulate.render import SHEET_RIM
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import (
    CENTRE_JITTER,
    MAX_DRAWS,
    PICTURE_MARGIN,
    PLACES,
    SIDE_RANGE,
    STEEPEST_SIGHT,
    TILT_DIRECTION_JITTER,
    TILT_RANGE,
)

# Newton on the angle converges quadratically from the observed radius.
_ANGLE_STEPS = 50
_ANGLE_TOLERANCE = 1e-14
_MISSED = 1e-9
# Points along a side of an outline that is tested for overlap, and pixels per pixel of that test.
_OUTLINE_POINTS = 16
_COARSENESS = 4
# Maximum angle of targets over the valid angle: beyond, a picture hardly changes.
_MAX_OF_VALID = 0.97


@dataclass(frozen=True, slots=True, eq=False)
class TrueFisheye(TrueCamera):
    """A fisheye lens of Kannala and Brandt, in the convention of ``cv2.fisheye``.

    A ray at the angle ``t`` from the axis is seen ``t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)``
    focal lengths from the principal point.
    """

    COEFFICIENTS: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4")

    distortion: Array = field(default_factory=lambda: np.zeros(4))

    def _radius(self, angle: Array) -> tuple[Array, Array]:
        """Return the observed radius at an angle, and its derivative."""
        square = angle**2
        powers = square[..., None] ** np.arange(1, 5)
        factor = 1.0 + powers @ self.distortion
        slope = 1.0 + powers @ (self.distortion * [3.0, 5.0, 7.0, 9.0])
        return angle * factor, slope

    def observed_radius(self, angle: float) -> float:
        """Return an angle's distance from the principal point in the picture, in focal lengths."""
        return float(self._radius(np.array(angle))[0])

    @property
    def valid_angle(self) -> float:
        """Angle, radians, up to which the observed radius grows."""
        angle = np.linspace(0.0, np.pi, 20001)
        falls = np.flatnonzero(self._radius(angle)[1] <= 0.0)
        return float(angle[falls[0]] if falls.size else np.pi)

    def sees(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points of the camera frame, shape (N, 3), the lens sees, shape (N,)."""
        angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
        return np.asarray(angle < self.valid_angle)

    def project(self, points: Array) -> Array:
        """Project points of the camera frame, shape (N, 3), to pixels, shape (N, 2)."""
        radius = np.hypot(points[..., 0], points[..., 1])
        observed, _ = self._radius(np.arctan2(radius, points[..., 2]))
        scale = observed / np.where(radius > 0.0, radius, 1.0)
        return self.pixels(points[..., :2] * scale[..., None])

    def distort(self, normalised: Array) -> Array:
        """Map ideal to observed normalised coordinates, shape (N, 2)."""
        ones = np.ones((*normalised.shape[:-1], 1))
        return self.observed(self.project(np.concatenate([normalised, ones], axis=-1)))

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """Return the unit rays of pixels, shape (N, 2), as shape (N, 3).

        Raises
        ------
        ValueError
            If a pixel lies beyond the rim of the lens.
        """
        observed = self.observed(pixels)
        radius = np.hypot(observed[..., 0], observed[..., 1])
        angle = radius.copy()
        for _ in range(_ANGLE_STEPS):
            seen, slope = self._radius(angle)
            step = (radius - seen) / np.where(slope > 0.0, slope, np.inf)
            angle += step
            if np.all(np.abs(step) < _ANGLE_TOLERANCE * (1.0 + angle)):
                break
        missed = np.abs(self._radius(angle)[0] - radius) > _MISSED
        if np.any(missed | (angle > self.valid_angle)):
            raise ValueError("a pixel lies beyond the rim of the lens")
        across = observed * (np.sin(angle) / np.where(radius > 0.0, radius, 1.0))[..., None]
        return np.concatenate([across, np.cos(angle)[..., None]], axis=-1)

    def undistort(self, pixels: npt.ArrayLike) -> Array:
        """Map pixels to ideal normalised coordinates, shape (N, 2).

        Raises
        ------
        ValueError
            If a pixel's ray is 90 degrees or more from the axis.
        """
        rays = self.rays(pixels)
        if np.any(rays[..., 2] <= 0.0):
            raise ValueError("a pixel's ray is 90 degrees or more from the axis")
        ideal: Array = rays[..., :2] / rays[..., 2:]
        return ideal

    def is_monotonic(self, slack: float = 1.1) -> bool:
        """Return whether the observed radius grows `slack` times beyond the farthest corner."""
        width, height = self.image_size
        far_x = max(self.cx, width - 1 - self.cx) / self.fx
        far_y = max(self.cy, height - 1 - self.cy) / self.fy
        rim = self._radius(np.array(self.valid_angle))[0]
        return bool(rim > slack * np.hypot(far_x, far_y))


def fisheye(
    field_of_view: float,
    distortion: npt.ArrayLike = (0.02, -0.01, 0.003, -0.0004),
    image_size: tuple[int, int] = (1280, 960),
) -> TrueFisheye:
    """Return a lens whose picture spans a full angle, in degrees, across its width."""
    half = np.radians(0.5 * field_of_view)
    coefficients = np.array(distortion, dtype=np.float64)
    width, height = image_size
    focal = 0.5 * width / (half * (1.0 + half ** (2.0 * np.arange(1, 5)) @ coefficients))
    centre = 0.51 * width, 0.49 * height
    return TrueFisheye(focal, 1.002 * focal, *centre, coefficients, image_size)


def image_circle(scene: Scene, margin: float = 2.0) -> Callable[[Array], Array]:
    """Return an overlay for `render` that blackens the picture around the lens's image circle.

    The image ends `margin` degrees beyond the farthest corner of the scene's targets.
    """
    camera = scene.camera
    if not isinstance(camera, TrueFisheye):
        raise TypeError(f"the camera must be a TrueFisheye, not {type(camera).__name__}")
    corners = np.vstack([target.to_camera(target.outlines()[0]) for target in scene.targets])
    angles = np.arctan2(np.hypot(corners[:, 0], corners[:, 1]), corners[:, 2])
    rim = camera.observed_radius(angles.max() + np.radians(margin))
    width, height = camera.image_size
    y = ((np.arange(height) - camera.cy) / camera.fy)[:, None]
    x = (np.arange(width) - camera.cx - camera.skew * y) / camera.fx
    coverage = np.clip(0.5 + camera.fx * (rim - np.hypot(x, y)), 0.0, 1.0)[..., None]
    return lambda light: light * coverage


def wide_scene(
    rng: np.random.Generator,
    camera: TrueFisheye,
    *,
    kind: str = "square",
    count: int = 3,
    dark: bool = True,
    size: float = 1.0,
) -> Scene:
    """Draw a scene of squares that a wide lens sees, each tilted against the ray to its middle.

    Their positions and sizes in the picture are those of `random_scene`, sizes times `size`.

    Raises
    ------
    ValueError
        If that many do not fit.
    """
    width, height = camera.image_size
    for _ in range(MAX_DRAWS):
        first = rng.uniform(0.0, 360.0)
        targets: list[Target] = []
        for i, place in enumerate(PLACES[count]):
            pixel = (place + rng.normal(0.0, CENTRE_JITTER, 2)) * [width, height]
            side = size * height * rng.uniform(*SIDE_RANGE)
            jitter = rng.uniform(-TILT_DIRECTION_JITTER, TILT_DIRECTION_JITTER)
            ray = camera.rays(pixel[None])[0]
            direction = first + 360.0 * i / count + jitter
            spin = rng.uniform(0.0, 360.0)
            rotation = towards(ray) @ tilted(rng.uniform(*TILT_RANGE), direction, spin)
            if rotation[:, 2] @ ray < np.cos(np.deg2rad(STEEPEST_SIGHT)):
                break
            target = Target(rotation, ray * camera.fx / side, kind=kind, dark=dark)  # type: ignore[arg-type]
            if not _is_inside(camera, target):
                break
            targets.append(target)
        if len(targets) == count and not meet(camera, targets):
            return Scene(camera, tuple(targets))
    raise ValueError(f"no {count} squares fit this camera's picture")


def towards(ray: Array) -> Array:
    """Return the shortest rotation from the axis to a unit ray, shape (3, 3)."""
    axis = np.array([0.0, 0.0, 1.0])
    across = np.cross(axis, ray)
    cross = np.array(
        [[0, -across[2], across[1]], [across[2], 0, -across[0]], [-across[1], across[0], 0]]
    )
    rotation: Array = np.eye(3) + cross + cross @ cross / (1.0 + ray[2])
    return rotation


def _outline(corners: Array) -> Array:
    fraction = np.linspace(0.0, 1.0, _OUTLINE_POINTS, endpoint=False)[:, None]
    sides = [a + fraction * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    return np.concatenate(sides)


def _is_inside(camera: TrueFisheye, target: Target) -> bool:
    """Return whether the figure stays clear of the picture's border and of the lens's rim."""
    points = target.to_camera(_outline(rectangle(*target.extent)))
    angle = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    if np.any(angle > _MAX_OF_VALID * camera.valid_angle):
        return False
    pixels = camera.project(points)
    low, high = PICTURE_MARGIN, np.array(camera.image_size) - 1.0 - PICTURE_MARGIN
    return bool(np.all(pixels > low) and np.all(pixels < high))


def meet(camera: TrueFisheye, targets: list[Target]) -> bool:
    """Return whether two squares' paper sheets meet in the picture, to a few pixels."""
    sheet = rectangle(0.5 + SHEET_RIM[1], 0.5 + SHEET_RIM[1])
    width, height = camera.image_size
    drawn = np.zeros((height // _COARSENESS, width // _COARSENESS), np.uint8)
    for target in targets:
        points = target.to_camera(_outline(sheet))
        if not np.all(camera.sees(points)):
            return True
        overlap = np.zeros_like(drawn)
        outline = np.rint(camera.project(points) / _COARSENESS).astype(np.int32)
        cv2.fillPoly(overlap, [outline], 1)
        drawn += overlap
    return bool(drawn.max() > 1)
