"""Photographs of known scenes, exact to the grey level: light, lens blur, pixel, tone, noise.

Everything is composed in linear light and coded by the tone curve; noise is added last.
Brightness is quoted in grey levels of the coded picture, 0 to 255, whatever the dtype.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from trisquare.simulate.clutter import cluttered_ground
from trisquare.simulate.motion_blur import Motion
from trisquare.simulate.pixel_coverage import quadrilateral_coverage
from trisquare.simulate.scene import Array, Scene, Target, rectangle, sides_of

Image = npt.NDArray[Any]
ToneCurve = Literal["linear", "srgb"] | float

WHITE = 255.0
# Minimum and maximum width of the paper beyond the figure, in units of the figure's side, so that
# nothing but paper is near an edge.
SHEET_RIM = (0.08, 0.13)
# Sheets of a cluttered picture differ a little in whiteness, as paper does.
_SHEET_TINT = 0.06
# Maximum colour cast of the light, per channel.
_LIGHT_TINT = 0.12


def decode_tone(coded: Array, tone: ToneCurve) -> Array:
    """Turn coded values (0 to 1) into linear light."""
    coded = np.clip(coded, 0.0, None)
    if tone == "linear":
        return coded
    if tone == "srgb":
        return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    light: Array = coded ** float(tone)
    return light


def encode_tone(light: Array, tone: ToneCurve) -> Array:
    """Turn linear light into coded values (0 to 1)."""
    light = np.clip(light, 0.0, None)
    if tone == "linear":
        return light
    if tone == "srgb":
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    coded: Array = light ** (1.0 / float(tone))
    return coded


def light_levels(contrast: float, tone: ToneCurve) -> tuple[float, float]:
    """Return the linear light of ink and paper whose grey levels differ by a contrast."""
    levels = np.array([WHITE - contrast, WHITE + contrast]) / (2.0 * WHITE)
    dark, light = decode_tone(levels, tone).tolist()
    return dark, light


def render(
    scene: Scene,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    blur: float = 0.8,
    contrast: float = 175.0,
    tone: ToneCurve = "linear",
    colour: bool = False,
    shading: float = 0.0,
    clutter: int = 0,
    background: Image | None = None,
    dtype: npt.DTypeLike = np.uint8,
    jpeg_quality: int | None = None,
    overlays: Sequence[Callable[[Array], Array]] = (),
    motion: Motion | None = None,
) -> Image:
    """Photograph a scene.

    Parameters
    ----------
    scene : Scene
        The camera and its targets.
    rng : numpy.random.Generator
        Source of the noise, the clutter, the tints and the direction of the shading.
    noise : float
        Standard deviation of the noise of each channel, grey levels. In a given `background`
        only the sheets become noisy: a photograph has its own noise.
    blur : float
        Standard deviation of the optical blur, pixels; the pixel's box adds to it.
    contrast : float
        Grey levels between dark and light, centred in the range, before shading.
    tone : {"linear", "srgb"} or float
        Tone curve; a number is a gamma, ``light = coded ** gamma``.
    colour : bool
        Make a BGR picture with a colour cast.
    shading : float
        Fraction of the light that is lost from one end of the picture to the other.
    clutter : int
        Number of things on the ground. The targets then lie on paper sheets.
    background : ndarray of uint8, shape (H, W) or (H, W, 3), optional
        Coded picture to render into, of the camera's image size.
    dtype : dtype
        uint8, uint16 (full range 65535) or float32 (1.0 is white; neither rounded nor clipped).
    jpeg_quality : int, optional
        Pass the (uint8) picture through JPEG.
    overlays : sequence of callable
        Functions that hide, stain or outshine parts of the scene, in the order of their
        application: each changes the linear light, shape (H, W, 1 or 3).
    motion : Motion, optional
        Motion of the camera while the shutter is open; it blurs a given `background`, too.

    Returns
    -------
    ndarray of dtype, shape (H, W) or (H, W, 3)
        Grey, or BGR if `colour` is set or the background has colour.
    """
    if blur <= 0.0 or contrast <= 0.0 or contrast > WHITE:
        raise ValueError(f"blur and contrast must be positive, got {blur} and {contrast}")
    dark, light = light_levels(contrast, tone)
    on_sheets = bool(clutter) or background is not None
    canvas = _ground(scene, rng, (dark, light), tone, clutter, background, blur)
    sheets = np.zeros(canvas.shape[:2])
    for target in scene.targets:
        ground, ink = (light, dark) if target.dark else (dark, light)
        if on_sheets:
            ground *= 1.0 - _SHEET_TINT * rng.random()
        if on_sheets or target.rim is not None or target.dark != scene.targets[0].dark:
            sheet = sides_of(_sheet(target, rng))
            if patch := quadrilateral_coverage(scene.camera, target, sheet, blur):
                below = canvas[patch.rows, patch.columns]
                below += patch.coverage[..., None] * (ground - below)
                covered = sheets[patch.rows, patch.columns]
                np.maximum(covered, patch.coverage, out=covered)
        for sign, sides in target.figure():
            if patch := quadrilateral_coverage(scene.camera, target, sides, blur):
                step = sign * (ink - ground) * patch.coverage
                canvas[patch.rows, patch.columns] += step[..., None]
    for overlay in overlays:
        canvas = overlay(canvas)
    if background is None:
        canvas = _illuminate(canvas, rng, shading, colour)
    if motion is not None:
        canvas = motion.blurred(canvas)
    coded = encode_tone(canvas, tone)
    spread = sheets[..., None] if background is not None else 1.0
    coded += noise / WHITE * spread * rng.standard_normal(coded.shape)
    return quantised(coded, np.dtype(dtype), jpeg_quality)


def render_into(
    background: Image,
    scene: Scene,
    rng: np.random.Generator,
    *,
    tone: ToneCurve = "srgb",
    **settings: Any,
) -> Image:
    """Render a scene's targets, each on a paper sheet, into an existing photograph.

    Parameters
    ----------
    background : ndarray of uint8, shape (H, W) or (H, W, 3)
        The photograph; its size must be the scene's image size.
    scene, rng, tone, **settings
        As for `render`; a target's ``dark`` gives its polarity.

    Returns
    -------
    ndarray of uint8, shape of `background`
    """
    return render(scene, rng, background=background, tone=tone, **settings)


def _ground(
    scene: Scene,
    rng: np.random.Generator,
    levels: tuple[float, float],
    tone: ToneCurve,
    clutter: int,
    background: Image | None,
    blur: float,
) -> Array:
    """Return the linear light behind the targets, shape (H, W, 1 or 3)."""
    width, height = scene.camera.image_size
    if background is not None:
        if background.shape[:2] != (height, width) or background.dtype != np.uint8:
            raise ValueError(
                f"the background must be uint8 of shape ({height}, {width}), "
                f"got {background.dtype} of shape {background.shape}"
            )
        coded = background.astype(np.float64)
    elif clutter:
        drawn = cluttered_ground(scene.camera.image_size, rng, clutter).astype(np.float64)
        coded = np.asarray(cv2.GaussianBlur(drawn, (0, 0), blur))
    else:
        bright = not scene.targets or scene.targets[0].dark
        return np.full((height, width, 1), levels[int(bright)])
    return decode_tone(coded.reshape(height, width, -1) / WHITE, tone)


def _sheet(target: Target, rng: np.random.Generator) -> Array:
    """Return corners of a paper sheet round the target, plane units; random rims are unequal."""
    half = np.array(target.extent)
    if target.rim is not None:
        return rectangle(*(half + target.rim))
    unit = 2.0 * half.min()
    rims = unit * rng.uniform(*SHEET_RIM, size=4)
    corners = rectangle(*half)
    corners[[0, 3], 0] -= rims[0]
    corners[[1, 2], 0] += rims[1]
    corners[[0, 1], 1] -= rims[2]
    corners[[2, 3], 1] += rims[3]
    return corners


def _illuminate(canvas: Array, rng: np.random.Generator, shading: float, colour: bool) -> Array:
    """Dim the canvas toward one side of the picture and give its light a colour."""
    height, width = canvas.shape[:2]
    if shading:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        x = np.linspace(-1.0, 1.0, width)[None, :] * np.cos(angle)
        y = np.linspace(-1.0, 1.0, height)[:, None] * np.sin(angle)
        fall = 0.5 * (1.0 + (x + y) / (abs(np.cos(angle)) + abs(np.sin(angle))))
        canvas = canvas * (1.0 - shading * fall)[..., None]
    if colour:
        canvas = canvas * (1.0 - _LIGHT_TINT * rng.random(3))
    return canvas


def quantised(coded: Array, dtype: np.dtype[Any], jpeg_quality: int | None) -> Image:
    """Turn coded values (0 to 1), shape (H, W, 1 or 3), into a picture of the given type."""
    if coded.shape[2] == 1:
        coded = coded[..., 0]
    if dtype == np.float32:
        return coded.astype(np.float32)
    if dtype not in (np.uint8, np.uint16):
        raise ValueError(f"dtype must be uint8, uint16 or float32, got {dtype}")
    full = np.iinfo(dtype).max
    picture: Image = np.clip(np.rint(coded * full), 0, full).astype(dtype)
    if jpeg_quality is None:
        return picture
    if dtype != np.uint8:
        raise ValueError("JPEG holds 8-bit pictures only")
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    if not done:
        raise ValueError(f"OpenCV could not code a JPEG of quality {jpeg_quality}")
    decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    return np.asarray(decoded, dtype=np.uint8)
