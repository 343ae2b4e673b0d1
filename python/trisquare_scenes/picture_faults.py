"""Pictures of scenes that a camera or a program has spoilt, with known truth.

Light is rendered exactly; a fault then acts where it does in a camera: on the light of each colour
(the lens), on the light at the sensor (exposure, blooming, motion), or on the coded values
(sharpening, two levels, interlacing, JPEG).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from trisquare.simulate.motion_blur import Motion
from trisquare.simulate.render import WHITE, decode_tone, encode_tone, quantised, render
from trisquare.simulate.scene import Array, Scene, Target

Image: TypeAlias = npt.NDArray[Any]
OnLight: TypeAlias = Callable[[Array], Array]
OnCoded: TypeAlias = Callable[[Image], Image]

PAPER = 215.0
"""Grey level of the light side of an edge, coded as sRGB: that of `render` at a contrast of 175."""


BLUR_STEPS = 8
"""Number of steps between the pictures of one blur each that are mixed for a varying blur."""


@dataclass(frozen=True, slots=True)
class PictureFault:
    """The faults of a picture.

    Attributes
    ----------
    on_light : sequence of callable
        Changes of the light, 1 being white, shape (H, W, channels), in order.
    on_coded : sequence of callable
        Changes of the coded picture, uint8, in order.
    colour_scales : (float, float, float), optional
        Factors by which the lens magnifies blue, green and red about the centre; the picture is
        then in colour.
    second_field : (float, float), optional
        Displacement of odd rows, pixels.
    corner_blur : float, optional
        Blur in the corners, pixels; it increases with the square of the distance from the middle.
    jpeg_quality : int, optional
    """

    on_light: Sequence[OnLight] = ()
    on_coded: Sequence[OnCoded] = ()
    colour_scales: tuple[float, float, float] | None = None
    second_field: tuple[float, float] | None = None
    corner_blur: float | None = None
    jpeg_quality: int | None = None


UNDAMAGED = PictureFault()


def photograph(
    scene: Scene, rng: np.random.Generator, fault: PictureFault, *, noise: float, blur: float
) -> Image:
    """Render a scene as sRGB with 8 bits, with a fault; noise is in grey levels.

    The camera is that of green light and of the even rows.
    """
    scales = fault.colour_scales
    channels = [
        _light(_magnified(scene, scale), blur, fault.corner_blur) for scale in scales or (1.0,)
    ]
    light = np.concatenate(channels, axis=2)
    if fault.second_field is not None:
        moved = _light(_displaced(scene, fault.second_field), blur, fault.corner_blur)
        light[1::2] = moved[1::2]
    for act in fault.on_light:
        light = act(light)
    coded = encode_tone(light, "srgb") + noise / WHITE * rng.standard_normal(light.shape)
    picture = quantised(coded, np.dtype(np.uint8), None)
    for change in fault.on_coded:
        picture = change(picture)
    if fault.jpeg_quality is not None:
        grey_or_bgr = picture.reshape(*picture.shape[:2], -1) / WHITE
        return quantised(grey_or_bgr, np.dtype(np.uint8), fault.jpeg_quality)
    return picture


def darkened(part: float) -> OnLight:
    """Reduce the light in the corners by a fraction, elsewhere by the square of the distance."""
    return lambda light: light * (1.0 - part * _towards_corners(light))


def sloped(part: float, direction: float) -> OnLight:
    """Reduce light by a fraction from one end of the picture to the other: degrees from x to y."""

    def act(light: Array) -> Array:
        height, width = light.shape[:2]
        y, x = np.mgrid[:height, :width]
        angle = np.deg2rad(direction)
        along = np.cos(angle) * (x / width - 0.5) + np.sin(angle) * (y / height - 0.5)
        return np.asarray(light * (1.0 - part * (0.5 + along))[..., None])

    return act


def exposed(factor: float) -> OnLight:
    """Expose such that the light sides are coded as `factor` times `PAPER`."""
    gain = decode_tone(np.array([factor * PAPER, PAPER]) / WHITE, "srgb")
    return lambda light: light * (gain[0] / gain[1])


def bloomed(share: float, spread: float) -> OnLight:
    """Spread a fraction of the light above white by a standard deviation in pixels."""

    def act(light: Array) -> Array:
        excess = share * np.maximum(light - 1.0, 0.0)
        around = cv2.GaussianBlur(excess, (0, 0), spread).reshape(light.shape)
        return np.asarray(np.minimum(light, 1.0) + around)

    return act


def winged(share: float, spread: float) -> OnLight:
    """Spread a fraction of all light by a standard deviation in pixels, as many lenses do."""

    def act(light: Array) -> Array:
        around = cv2.GaussianBlur(light, (0, 0), spread).reshape(light.shape)
        return np.asarray((1.0 - share) * light + share * around)

    return act


def defocused(radius: float) -> OnLight:
    """Spread all light evenly over a disc of a radius in pixels, as a lens out of focus does."""
    reach, parts = int(np.ceil(radius)), 20
    offsets = (np.arange((2 * reach + 1) * parts) + 0.5) / parts - reach - 0.5
    is_inside = np.hypot(offsets, offsets[:, None]) < radius
    disc = is_inside.reshape(2 * reach + 1, parts, -1, parts).mean(axis=(1, 3))
    kernel = disc / disc.sum()
    return lambda light: np.asarray(cv2.filter2D(light, -1, kernel).reshape(light.shape), float)


def moved(length: float, direction: float) -> OnLight:
    """Move the camera along a line, pixels and degrees, while the shutter is open."""
    return Motion(length, direction).blurred


def sharpened(amount: float, radius: float) -> OnCoded:
    """Sharpen by unsharp masking, as cameras and editors do."""

    def act(picture: Image) -> Image:
        values = picture.astype(np.float64)
        values += amount * (values - cv2.GaussianBlur(values, (0, 0), radius))
        return np.clip(np.rint(values), 0, WHITE).astype(np.uint8)

    return act


def styled(slope: float) -> OnCoded:
    """Raise the contrast of middle levels by a logistic curve, as phones and editors do."""
    levels = 1.0 / (1.0 + np.exp(-slope * (np.arange(WHITE + 1.0) / WHITE - 0.5)))
    curve = WHITE * (levels - levels[0]) / (levels[-1] - levels[0])

    return lambda picture: np.rint(curve[picture]).astype(np.uint8)


def filtered(blur: float) -> OnLight:
    """Blur the light by a normal filter on the grid of pixels, `blur` pixels wide (std)."""

    def act(light: Array) -> Array:
        blurred: Array = np.asarray(cv2.GaussianBlur(light, (0, 0), blur), dtype=np.float64)
        return blurred.reshape(light.shape)

    return act


def rolled_off(knee: float, steepness: float) -> OnLight:
    """Compress coded values above a knee, 1 being white, as cameras do with highlights.

    Above it the coded value approaches white exponentially, the faster the steeper, and reaches it.
    """

    def act(light: Array) -> Array:
        coded = encode_tone(np.clip(light, 0.0, 1.0), "srgb")
        above = np.maximum(coded - knee, 0.0) / (1.0 - knee)
        risen = np.expm1(-steepness * above) / np.expm1(-steepness)
        return decode_tone(np.where(coded > knee, knee + (1.0 - knee) * risen, coded), "srgb")

    return act


def thresholded(level: int | None) -> OnCoded:
    """Reduce the picture to black and white; the level is Otsu's (1979) if None."""

    def act(picture: Image) -> Image:
        method = cv2.THRESH_BINARY | (cv2.THRESH_OTSU if level is None else 0)
        return np.asarray(cv2.threshold(picture, level or 0, WHITE, method)[1], dtype=np.uint8)

    return act


def made_smaller(scene: Scene, picture: Image, size: tuple[int, int]) -> tuple[Scene, Image]:
    """Average a coded picture's pixels to a smaller size; return the scene with its camera too."""
    camera = scene.camera
    wide, high = (new / old for new, old in zip(size, camera.image_size, strict=True))
    smaller = replace(
        camera,
        fx=wide * camera.fx,
        fy=high * camera.fy,
        cx=wide * (camera.cx + 0.5) - 0.5,
        cy=high * (camera.cy + 0.5) - 0.5,
        skew=wide * camera.skew,
        image_size=size,
    )
    averaged = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return replace(scene, camera=smaller), np.asarray(averaged, dtype=picture.dtype)


@dataclass(frozen=True, slots=True, eq=False)
class ReliefTarget(Target):
    """A square or a frame on paper that is not flat.

    Parameters
    ----------
    relief : (float, float, float)
        Height above the plane as multiples of ``x^2``, ``x y`` and ``y^2``, in plane units.
    """

    relief: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def to_camera(self, plane_points: npt.ArrayLike) -> Array:
        """Map points of the paper into the camera frame, shape (N, 3)."""
        points = np.asarray(plane_points, dtype=np.float64)
        x, y = points[:, 0], points[:, 1]
        height = self.relief[0] * x * x + self.relief[1] * x * y + self.relief[2] * y * y
        return Target.to_camera(self, points) + height[:, None] * np.asarray(self.rotation)[:, 2]


def with_relief(scene: Scene, rng: np.random.Generator, height: float) -> Scene:
    """Bend the paper of every target, by `height` of its side between lowest and highest."""
    targets = []
    for target in scene.targets:
        bend = rng.standard_normal(3)
        grid = np.linspace(-0.5, 0.5, 11)
        x, y = np.meshgrid(grid, grid)
        heights = bend[0] * x * x + bend[1] * x * y + bend[2] * y * y
        scale = height / float(np.ptp(heights))
        relief = (scale * bend[0], scale * bend[1], scale * bend[2])
        names = ("rotation", "translation", "kind", "dark", "inner", "printed", "rim")
        members = {name: getattr(target, name) for name in names}
        targets.append(ReliefTarget(**members, relief=relief))
    return replace(scene, targets=tuple(targets))


def _towards_corners(light: Array) -> Array:
    """Return the squared distance from the middle, 1 in the corners: shape (H, W, 1)."""
    height, width = light.shape[:2]
    y, x = np.mgrid[:height, :width]
    square = (x - 0.5 * (width - 1)) ** 2 + (y - 0.5 * (height - 1)) ** 2
    return np.asarray(square[..., None] / square[0, 0])


def _light(scene: Scene, blur: float, corner_blur: float | None) -> Array:
    if corner_blur is None:
        return _evenly_blurred(scene, blur)
    # A mixture of two slightly different blurs has the correct variance, and nearly the shape.
    blurs = np.linspace(blur, corner_blur, BLUR_STEPS + 1)
    pictures = [_evenly_blurred(scene, float(blur_of_step)) for blur_of_step in blurs]
    own = np.square(blur + (corner_blur - blur) * _towards_corners(pictures[0]))
    variances = np.square(blurs)
    light = np.zeros_like(pictures[0])
    for number, picture in enumerate(pictures):
        hat = np.zeros(len(blurs))
        hat[number] = 1.0
        light += np.interp(own, variances, hat) * picture
    return light


def _evenly_blurred(scene: Scene, blur: float) -> Array:
    # Float pictures are neither rounded nor clipped; without noise no random numbers are drawn.
    coded = render(
        scene, np.random.default_rng(0), tone="srgb", noise=0.0, blur=blur, dtype=np.float32
    )
    return decode_tone(coded.astype(np.float64)[..., None], "srgb")


def _magnified(scene: Scene, scale: float) -> Scene:
    camera = scene.camera
    width, height = camera.image_size
    centre_x, centre_y = 0.5 * (width - 1), 0.5 * (height - 1)
    return replace(
        scene,
        camera=replace(
            camera,
            fx=scale * camera.fx,
            fy=scale * camera.fy,
            cx=centre_x + scale * (camera.cx - centre_x),
            cy=centre_y + scale * (camera.cy - centre_y),
            skew=scale * camera.skew,
        ),
    )


def _displaced(scene: Scene, by: tuple[float, float]) -> Scene:
    camera = replace(scene.camera, cx=scene.camera.cx + by[0], cy=scene.camera.cy + by[1])
    return replace(scene, camera=camera)
