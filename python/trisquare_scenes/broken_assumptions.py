"""Pictures that each break one assumption of the calibration, with their truth.

Each kind is drawn damaged and undamaged from the same seed, so that a warning about the damage can
be distinguished from one about the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np

from trisquare._support.rotations import tilted
from trisquare.simulate.fisheye import TrueFisheye
from trisquare.simulate.render import Image, render
from trisquare.simulate.scene import Array, Scene, Target, TrueCamera, rectangle
from trisquare.simulate.scenes import inside, random_camera, random_scene
from trisquare_scenes.other_lenses import PrismCamera, RationalCamera

NOISE = (1.0, 4.0)
"""Standard deviation of the noise, grey levels."""

BLUR = (0.5, 1.2)
"""Standard deviation of the blur, pixels."""


class Broken(NamedTuple):
    """Pictures of one camera, and its true focal length `fx`, pixels."""

    pictures: list[Image]
    focal: float


@dataclass(frozen=True, slots=True, eq=False)
class BentTarget(Target):
    """A target on a surface that is not flat.

    Parameters
    ----------
    curvature : float
        Curvature of a cylinder on which it lies, per unit of the plane.
    direction : float
        Direction of the cylinder's axis in the plane, radians.
    twist : float
        Height above the plane, as a multiple of ``x y``, per unit of the plane.
    """

    curvature: float = 0.0
    direction: float = 0.0
    twist: float = 0.0

    def to_camera(self, plane_points: Any) -> Array:
        """Map points of the paper, shape (N, 2), into the camera frame, shape (N, 3)."""
        points = np.asarray(plane_points, dtype=np.float64)
        across = np.array([-np.sin(self.direction), np.cos(self.direction)])
        way = points @ across
        height = self.twist * points[..., 0] * points[..., 1]
        if self.curvature:
            bent = np.sin(self.curvature * way) / self.curvature
            points = points + (bent - way)[..., None] * across
            height = height + (1.0 - np.cos(self.curvature * way)) / self.curvature
        lifted = np.concatenate([points, height[..., None]], axis=-1)
        return np.asarray(lifted @ self.rotation.T + self.translation)


Draw: TypeAlias = Callable[[np.random.Generator, bool], Broken]


def settings(rng: np.random.Generator) -> dict[str, Any]:
    """Draw the conditions of a picture: arguments of `render`."""
    return {"noise": rng.uniform(*NOISE), "blur": rng.uniform(*BLUR), "tone": "srgb"}


def of_targets(change: Callable[[np.random.Generator, Target], Target], which: int | None) -> Draw:
    """Damage one target of three, or all of them alike (`which` is None)."""

    def draw(rng: np.random.Generator, damaged: bool) -> Broken:
        scene, how = random_scene(rng), settings(rng)
        seed = int(rng.integers(2**32))
        targets = [
            change(np.random.default_rng(seed), target)
            if damaged and which in (None, index)
            else target
            for index, target in enumerate(scene.targets)
        ]
        picture = render(Scene(scene.camera, tuple(targets)), rng, **how)
        return Broken([picture], scene.camera.fx)

    return draw


def rectangular(ratio: float) -> Callable[[np.random.Generator, Target], Target]:
    """Return a change to rectangles of up to this ratio, turned in their planes as the squares."""

    def change(rng: np.random.Generator, target: Target) -> Target:
        return replace(target, printed=rectangle(0.5 * rng.uniform(1.003, ratio), 0.5))

    return change


def sheared(rng: np.random.Generator, target: Target) -> Target:
    """Return it as drawn by a printer whose axes are not perpendicular."""
    shear = np.array([[1.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.003, 0.03)], [0.0, 1.0]])
    return replace(target, printed=rectangle(0.5, 0.5) @ shear.T)


def bent(target: Target, **how: Any) -> BentTarget:
    """Return it on a surface that is not flat."""
    own = {f.name: getattr(target, f.name) for f in fields(Target)}
    return BentTarget(**own, **how)


def rolled(rng: np.random.Generator, target: Target) -> Target:
    """Return it on a cylinder: its middle is 0.5 to 3 % of a side off the plane of its rim."""
    curvature = 8.0 * rng.uniform(0.005, 0.03) * rng.choice([-1.0, 1.0])
    return bent(target, curvature=curvature, direction=rng.uniform(0.0, np.pi))


def twisted(rng: np.random.Generator, target: Target) -> Target:
    """Return it with one corner 0.5 to 3 % of a side off the plane of the others."""
    return bent(target, twist=rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.03))


def upright_rectangles(rng: np.random.Generator, damaged: bool) -> Broken:
    """Draw windows: rectangles of one ratio, all with their long sides nearly level."""
    ratio = rng.uniform(1.005, 1.1) if damaged else 1.0
    while True:
        scene = random_scene(rng)
        targets = tuple(
            replace(
                target,
                rotation=tilted(rng.uniform(25, 50), first, -first + rng.uniform(-10, 10)),
                printed=rectangle(0.5 * ratio, 0.5),
            )
            for target, first in zip(
                scene.targets, rng.uniform(0, 360) + 120 * np.arange(3), strict=True
            )
        )
        if all(inside(scene.camera, target) for target in targets):
            break
    picture = render(Scene(scene.camera, targets), rng, **settings(rng))
    return Broken([picture], scene.camera.fx)


def of_lens(change: Callable[[np.random.Generator, TrueCamera], TrueCamera]) -> Draw:
    """Photograph scenes through another lens."""

    def draw(rng: np.random.Generator, damaged: bool) -> Broken:
        usual = random_camera(rng)
        camera = change(rng, usual) if damaged else usual
        scene = random_scene(rng, camera=camera)
        return Broken([render(scene, rng, **settings(rng))], camera.fx)

    return draw


def decentred(rng: np.random.Generator, usual: TrueCamera) -> TrueCamera:
    """Return a lens with tangential distortion."""
    return replace(
        usual, distortion=usual.distortion + np.array([0, 0, *rng.normal(0.0, 0.004, 2), 0])
    )


def third_order(rng: np.random.Generator, usual: TrueCamera) -> TrueCamera:
    """Return a lens with a third radial coefficient."""
    for _ in range(1000):
        k3 = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.3)
        camera = replace(usual, distortion=usual.distortion + np.array([0, 0, 0, 0, k3]))
        if camera.is_monotonic():
            return camera
    return replace(usual, distortion=np.array([-0.3, 0.1, 0.0, 0.0, -0.02]))


def prismatic(rng: np.random.Generator, usual: TrueCamera) -> TrueCamera:
    """Return a lens with a thin prism's terms."""
    return PrismCamera(**_members(usual), prism=rng.normal(0.0, 0.004, 4))


def rational(rng: np.random.Generator, usual: TrueCamera) -> TrueCamera:
    """Return a wide lens whose radial distortion is a quotient."""
    wide = replace(usual, fx=0.6 * usual.fx, fy=0.6 * usual.fy, distortion=np.zeros(5))
    below = rng.uniform(0.3, 0.9)
    return RationalCamera(**_members(wide), above=below - rng.uniform(0.15, 0.3), below=below)


def fisheye(rng: np.random.Generator, usual: TrueCamera) -> TrueCamera:
    """Return an equidistant lens that sees 90 to 140 degrees from corner to corner."""
    focal = 800.0 / np.radians(rng.uniform(45.0, 70.0))
    members = _members(usual) | {"fx": focal, "fy": focal, "distortion": np.zeros(4)}
    return TrueFisheye(**members)


def _members(camera: TrueCamera) -> dict[str, Any]:
    return {f.name: getattr(camera, f.name) for f in fields(TrueCamera)}


def of_picture(change: Callable[[np.random.Generator, Image], Image], **options: Any) -> Draw:
    """Change the picture after it has been taken."""

    def draw(rng: np.random.Generator, damaged: bool) -> Broken:
        scene = random_scene(rng)
        picture = render(scene, rng, **settings(rng) | (options if damaged else {}))
        return Broken([change(rng, picture) if damaged else picture], scene.camera.fx)

    return draw


def photo_of_photo(rng: np.random.Generator, picture: Image) -> Image:
    """Return the view of a second camera that looks at the print at an angle."""
    height, width = picture.shape[:2]
    corners = rectangle(0.5 * width, 0.5 * height)
    turn = tilted(rng.uniform(8.0, 25.0), rng.uniform(0.0, 360.0), 0.0)
    projected = corners @ turn[:, :2].T + [0.0, 0.0, 1.2 * width]
    projected = 1.1 * width * projected[:, :2] / projected[:, 2:] + [0.5 * width, 0.5 * height]
    pixels = corners - corners[0]
    matrix = cv2.getPerspectiveTransform(pixels.astype(np.float32), projected.astype(np.float32))
    return np.asarray(
        cv2.warpPerspective(
            picture, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
    )


def cropped(rng: np.random.Generator, picture: Image) -> Image:
    """Return it without a part of one side that shows no target."""
    empty = (picture > picture.max() // 2).all(axis=0)
    first = int(np.argmin(empty))
    return np.ascontiguousarray(picture[:, max(first - 12, 0) :])


def stretched(rng: np.random.Generator, picture: Image) -> Image:
    """Return it stretched in width by 1 to 10 %, as a film's pixels are shown."""
    height, width = picture.shape[:2]
    size = (round(width * rng.uniform(1.01, 1.1)), height)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC))


def skewed(rng: np.random.Generator, picture: Image) -> Image:
    """Return it sheared by 0.3 to 3 %, as by a rolling shutter that moves or by a scanner."""
    height, width = picture.shape[:2]
    shear = rng.choice([-1.0, 1.0]) * rng.uniform(0.003, 0.03)
    matrix = np.array([[1.0, shear, -0.5 * shear * (height - 1)], [0.0, 1.0, 0.0]])
    return np.asarray(
        cv2.warpAffine(
            picture, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
    )


def patterned(rng: np.random.Generator, picture: Image) -> Image:
    """Return it with moire: waves of light of a few pixels."""
    height, width = picture.shape[:2]
    y, x = np.mgrid[:height, :width]
    angle, period = rng.uniform(0.0, np.pi), rng.uniform(4.0, 12.0)
    wave = np.sin(2.0 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
    return np.asarray(np.clip(picture * (1.0 + 0.08 * wave), 0, 255).round().astype(np.uint8))


def shadowed(rng: np.random.Generator, picture: Image) -> Image:
    """Return it with the shadow of a pole across it."""
    height, width = picture.shape[:2]
    y, x = np.mgrid[:height, :width]
    angle = rng.uniform(0.0, np.pi)
    distance = (x - 0.5 * width) * np.cos(angle) + (y - 0.5 * height) * np.sin(angle)
    half_width, softness = rng.uniform(30.0, 120.0), rng.uniform(1.0, 6.0)
    shade = 0.5 + 0.5 * np.tanh((half_width - np.abs(distance)) / softness)
    return np.asarray((picture * (1.0 - 0.4 * shade)).round().astype(np.uint8))


def unchanged(rng: np.random.Generator, picture: Image) -> Image:
    """Return it unchanged: it was rendered with its damage."""
    return picture


def mirrored(rng: np.random.Generator, picture: Image) -> Image:
    """Return its mirror image."""
    return np.ascontiguousarray(picture[:, ::-1])


def two_zooms(rng: np.random.Generator, damaged: bool) -> Broken:
    """Draw two pictures, the second one of which is taken with another focal length."""
    camera = random_camera(rng)
    zoom = rng.uniform(1.03, 1.3) if damaged else 1.0
    return Broken(zoomed_pictures(rng, camera, zoom), camera.fx)


def zoomed_pictures(rng: np.random.Generator, camera: TrueCamera, zoom: float) -> list[Image]:
    """Draw a picture of a camera, and one with `zoom` times its focal lengths."""
    zoomed = replace(camera, fx=zoom * camera.fx, fy=zoom * camera.fy)
    scenes = [random_scene(rng, camera=scene_camera) for scene_camera in (camera, zoomed)]
    return [render(scene, rng, **settings(rng)) for scene in scenes]


@dataclass(frozen=True, slots=True)
class Kind:
    """One broken assumption.

    Attributes
    ----------
    draw : callable
        Draws pictures, damaged or undamaged.
    causes : frozenset of str
        Codes of the warnings that name it.
    is_detectable : bool
        Whether it can be detected from the picture, or from what is known of all cameras.
    """

    draw: Draw
    causes: Sequence[str]
    is_detectable: bool = True


NO_SQUARES = (
    "planes_contradict",
    "plane_disagrees",
    "plane_rejected",
    "plane_stretched",
    "choice_uncertain",
    "pixels_not_square",
    "principal_point_off_centre",
)
NOT_FLAT = (*NO_SQUARES, "correlated_residuals", "side_rejected")
LENS = ("lens_beyond_model",)
STRETCH = ("pixels_not_square", "principal_point_off_centre", "planes_contradict")
CODING = ("no_tone_curve", "tone_contradicted")

KINDS: Mapping[str, Kind] = {
    "all rectangles 1.003-1.1, turned": Kind(of_targets(rectangular(1.1), None), NO_SQUARES),
    "all rectangles 1.005-1.1, upright": Kind(upright_rectangles, NO_SQUARES),
    "one rectangle 1.003-1.1": Kind(of_targets(rectangular(1.1), 0), NO_SQUARES),
    "all targets sheared": Kind(of_targets(sheared, None), NO_SQUARES),
    "one target sheared": Kind(of_targets(sheared, 0), NO_SQUARES),
    "all on cylinders": Kind(of_targets(rolled, None), NOT_FLAT),
    "one on a cylinder": Kind(of_targets(rolled, 0), NOT_FLAT),
    "all twisted": Kind(of_targets(twisted, None), NOT_FLAT),
    "one twisted": Kind(of_targets(twisted, 0), NOT_FLAT),
    "tangential lens": Kind(of_lens(decentred), LENS),
    "thin prism lens": Kind(of_lens(prismatic), LENS),
    "lens with k3": Kind(of_lens(third_order), LENS),
    "rational lens": Kind(of_lens(rational), LENS),
    "fisheye": Kind(of_lens(fisheye), LENS),
    "photo of a photo": Kind(of_picture(photo_of_photo), (*STRETCH, *NO_SQUARES)),
    "cropped": Kind(of_picture(cropped), STRETCH),
    "stretched": Kind(of_picture(stretched), STRETCH),
    "sheared": Kind(of_picture(skewed), ("pixels_not_square",)),
    "mirrored": Kind(of_picture(mirrored), (), is_detectable=False),
    "moire": Kind(of_picture(patterned), ("periodic_pattern", *CODING)),
    "shadow": Kind(of_picture(shadowed), (*CODING, "side_partly_hidden", "side_rejected")),
    "JPEG 30": Kind(of_picture(unchanged, jpeg_quality=30), CODING),
    "two zooms": Kind(two_zooms, ("pictures_disagree", *NO_SQUARES)),
}
"""All kinds by name. The mirrored picture is that of a possible camera with the true focal
length."""
