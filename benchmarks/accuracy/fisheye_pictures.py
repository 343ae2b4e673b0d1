"""Pictures of fisheye lenses of 100-190 degrees: squares found, error, coverage and warnings.

Silently wrong: fx is off by more than 4 std and 0.3 %, and there is no warning above low severity.
"""

from __future__ import annotations

import numpy as np
from accuracy.fisheye_edges import HALF_WIDTH, NAMES, camera_of, values
from harness.rows import Row, coverage_row
from harness.truth import rms

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.render import Image

SCENES = 60
POOR_SCENES = 100
CIRCLE_SCENES = 30
CLUTTER = 20  # objects in the background
SEED = 72
FIELD_RANGE = (100.0, 190.0)  # degrees across the picture's width
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
CONTRAST = 175.0  # grey levels
MIN_FOUND = 58
MAX_OVER_BOUND = 1.15
COVERAGE = (0.92, 0.98)
# An answer is wrong where its error exceeds both limits.
WRONG_STDS = 4.0
WRONG_PART = 0.003


def measure() -> list[Row]:
    """Print the number of squares found, and the errors relative to bounds and stated stds."""
    ratios, covered = [], []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        scene, picture, sigma = _photograph(rng)
        result = _of_all_squares(f"scene {number}", scene, picture, tone="linear")
        if result is None:
            continue
        error = values(result.camera) - values(camera_of(scene))
        bound = simulate.cramer_rao_bound(scene, sigma, free=NAMES)
        ratios.append(error / [bound[name] for name in NAMES])
        covered.append(np.abs(error) <= HALF_WIDTH * np.array([result.std[n] for n in NAMES]))
    ratio, share = rms(np.array(ratios)), float(np.mean(covered))
    found, off = _in_circles()
    silent, warned = _with_radial2()
    pictures = f"{SCENES} pictures, `fisheye`"
    circles = f"{CIRCLE_SCENES} pictures with an image circle and clutter, `fisheye`"
    return [
        Row(
            f"{pictures}: all squares found",
            f"{len(ratios)} of {SCENES}",
            f">= {MIN_FOUND}",
            len(ratios) >= MIN_FOUND,
        ),
        Row(
            f"{pictures}: error / Cramer-Rao bound",
            f"{ratio:.2f}",
            f"<= {MAX_OVER_BOUND}",
            ratio <= MAX_OVER_BOUND,
        ),
        coverage_row(pictures, share, COVERAGE),
        Row(
            f"{circles}: all squares found",
            f"{found} of {CIRCLE_SCENES}",
            f">= {CIRCLE_SCENES - 1}",
            found >= CIRCLE_SCENES - 1,
        ),
        Row(f"{circles}: error / std of fx, rms", f"{off:.2f}", "", None),
        Row(
            f"{POOR_SCENES} pictures, `radial2`: silently wrong",
            f"{silent}",
            "0",
            silent == 0,
        ),
        Row(
            f"{POOR_SCENES} pictures, `radial2`: fisheye named as the cause", f"{warned}", "", None
        ),
    ]


def _photograph(rng: np.random.Generator) -> tuple[simulate.Scene, Image, float]:
    """Return a scene, its picture, and the bound on the standard deviation of an edge pixel."""
    camera = simulate.fisheye(rng.uniform(*FIELD_RANGE))
    scene = simulate.wide_scene(rng, camera)
    noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
    picture = simulate.render(scene, rng, noise=noise, blur=blur, contrast=CONTRAST, tone="linear")
    return scene, picture, simulate.pixel_sigma(noise, CONTRAST, blur)


def _of_all_squares(
    name: str, scene: simulate.Scene, picture: Image, tone: str | None = None
) -> ts.Calibration | None:
    """Calibrate a fisheye; print the reason and return None unless all squares are used."""
    try:
        result = ts.calibrate(picture, model="fisheye", tone=tone)
    except ts.TrisquareError as error:
        print(f"  {name}: {error}")
        return None
    if len(result.planes) < len(scene.targets):
        print(f"  {name}: {len(result.planes)} squares")
        return None
    return result


def _in_circles() -> tuple[int, float]:
    """Count the scenes with all squares found, and return the rms of fx's error / std."""
    errors = []
    for number in range(CIRCLE_SCENES):
        rng = np.random.default_rng([SEED, 2, number])
        scene = simulate.wide_scene(rng, simulate.fisheye(rng.uniform(*FIELD_RANGE)))
        overlays = (simulate.image_circle(scene),)
        picture = simulate.render(scene, rng, tone="srgb", clutter=CLUTTER, overlays=overlays)
        result = _of_all_squares(f"circle {number}", scene, picture)
        if result is not None:
            errors.append((result.camera.fx - scene.camera.fx) / result.std["fx"])
    return len(errors), rms(np.array(errors))


def _with_radial2() -> tuple[int, int]:
    """Count answers that are wrong without a warning, and those whose warnings name the fisheye."""
    silent = named = 0
    for number in range(POOR_SCENES):
        rng = np.random.default_rng([SEED, 1, number])
        scene, picture, _ = _photograph(rng)
        try:
            result = ts.calibrate(picture, tone="linear")
        except ts.TrisquareError:
            continue
        off = abs(result.camera.fx - scene.camera.fx)
        is_wrong = off > WRONG_STDS * result.std["fx"] and off > WRONG_PART * scene.camera.fx
        is_warned = any(warning.severity != "low" for warning in result.warnings)
        silent += is_wrong and not is_warned
        named += any("fisheye" in warning for warning in result.warnings)
    return silent, named
