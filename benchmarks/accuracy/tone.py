"""Tone curve estimated: error of fx, standard deviation and coverage.

All pictures are calibrated without options, that is with `tone="auto"`. The tone curves are gammas
of 1 to 2.6 and sRGB. Compressed highlights are outside the family of estimated curves.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from harness.faulty_pictures import calibrated
from harness.rows import Row
from harness.truth import NAMES, by_name, errors

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.render import ToneCurve
from trisquare_scenes.picture_faults import PictureFault, filtered, made_smaller, rolled_off

TONES: tuple[ToneCurve, ...] = (1.0, 1.4, 1.8, 2.2, 2.6, "srgb")
SCENES = 40
SEED = 12
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
BIAS_TARGET = 0.5  # standard deviations
STD_TARGET = 1.3
TWO_SIDED_95 = 1.96

DEPTH_SEED = 1204
DEPTH_SCENES = 20  # of each kind
DEPTHS: dict[str, dict[str, Any]] = {
    "16-bit sRGB": {"tone": "srgb", "dtype": np.uint16},
    "16-bit linear": {"tone": "linear", "dtype": np.uint16},
    "8-bit, gamma 1.8-2.6": {},
    "8-bit sRGB, JPEG 85": {"tone": "srgb", "jpeg_quality": 85},
}
DEPTH_TARGETS = 1.15, 0.015  # error / std; % of fx

RESIZED_SEED = 1206
RESIZED_SCENES = 20  # of each size
RESIZED_FACTORS = 0.75, 0.5
RESIZED_TARGET = 1.3  # error / std

ROLLED_OFF_SEED = 1207
ROLLED_OFF_SCENES = 20  # of each quality
KNEE, STEEPNESS = 0.6, 1.6
ROLLED_OFF_QUALITIES = None, 95, 88  # of JPEG
ROLLED_OFF_TARGET = 1.3  # error / std

FILTERED_SEED = 1208
FILTERED_SCENES = 20  # of each filter
FILTER_BLURS = 0.0, 0.5, 0.8  # pixels
FILTERED_TARGET = 1.3  # error / std
LENS_BLUR = 0.05  # pixels

PHONE_SEED = 1205
PHONE_SCENES = 20
PHONE_TARGET = 1.3
PHONE_QUALITIES = (88, 96)  # of JPEG
PHONE = simulate.TrueCamera(1500.0, 1500.0, 1005.0, 745.0, (0.08, -0.15, 0, 0, 0), (2000, 1500))


def measure() -> list[Row]:
    """Print the bias of fx for each curve, and its spread relative to that with a known curve."""
    biases, ratios, error_ratios, covered = [], [], [], []
    for tone in TONES:
        scores, known_scores, ratio, inside = _scores(tone)
        bias, error = float(scores.mean()), float(scores.std() / np.sqrt(SCENES))
        error_ratio = float(np.sqrt(np.mean((scores * ratio) ** 2) / np.mean(known_scores**2)))
        print(
            f"  {tone}: bias of fx {bias:+.2f} +- {error:.2f} std (curve known: "
            f"{known_scores.mean():+.2f}), std / that of the known curve: median "
            f"{np.median(ratio):.2f}, largest {ratio.max():.2f}, errors {error_ratio:.2f}; "
            f"coverage {100 * inside:.0f} %"
        )
        biases.append(bias)
        ratios.append(float(np.sqrt(np.mean(ratio**2))))
        error_ratios.append(error_ratio)
        covered.append(inside)
    further = [
        *_depth_rows(),
        *_resized_rows(),
        *_rolled_off_rows(),
        *_filtered_rows(),
        _phone_row(),
    ]
    worst = max(biases, key=abs)
    name = f"{len(TONES)} tone curves x {SCENES} pictures"
    return [
        Row(
            f"{name}: mean error / std of fx, worst curve",
            f"{worst:+.2f}",
            f"within {BIAS_TARGET}",
            abs(worst) < BIAS_TARGET,
        ),
        Row(
            f"{name}: std of fx / std with the curve stated, rms, worst curve (ratio of errors)",
            f"{max(ratios):.2f} ({max(error_ratios):.2f})",
            f"<= {STD_TARGET}",
            max(ratios) <= STD_TARGET,
        ),
        Row(
            f"{name}: coverage of the 95 % intervals",
            f"{100 * np.mean(covered):.1f} %",
            "92-97 %",
            0.92 <= np.mean(covered) <= 0.97,
        ),
        *further,
    ]


def _depth_rows() -> list[Row]:
    """Calibrate pictures of several depths and curves without options."""
    rows = []
    for name, kind in DEPTHS.items():
        ratios, percents = [], []
        for seed in range(DEPTH_SCENES):
            rng = np.random.default_rng([DEPTH_SEED, seed])
            scene = simulate.random_scene(rng, kind="square" if seed % 2 else "frame")
            noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
            options = kind or {"tone": float(rng.uniform(1.8, 2.6))}
            picture = simulate.render(scene, rng, noise=noise, blur=blur, **options)
            found = ts.calibrate(picture)
            ratios.append(errors(found, scene.camera) / by_name(found.std))
            percents.append(100.0 * abs(found.camera.fx / scene.camera.fx - 1.0))
        ratio, percent = float(np.sqrt(np.mean(np.square(ratios)))), float(np.median(percents))
        print(f"  {name}: error / std, rms {ratio:.2f}, fx median {percent:.4f} %")
        most_ratio, most_percent = DEPTH_TARGETS
        rows.append(
            Row(
                f"{name}, {DEPTH_SCENES} pictures: error / std, rms; median error of fx",
                f"{ratio:.2f}; {percent:.4f} %",
                f"<= {most_ratio}; <= {most_percent} %",
                ratio <= most_ratio and percent <= most_percent,
            )
        )
    return rows


def _resized_rows() -> list[Row]:
    """Calibrate sRGB pictures that were reduced in size after coding."""
    rows = []
    for factor in RESIZED_FACTORS:
        ratios = []
        for seed in range(RESIZED_SCENES):
            rng = np.random.default_rng([RESIZED_SEED, seed])
            size = (1280, 960)
            drawn = simulate.random_scene(
                rng,
                kind="square" if seed % 2 else "frame",
                image_size=(round(size[0] / factor), round(size[1] / factor)),
            )
            noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
            whole = simulate.render(drawn, rng, noise=noise, blur=blur, tone="srgb")
            scene, picture = made_smaller(drawn, whole, size)
            found = ts.calibrate(picture)
            ratios.append(errors(found, scene.camera) / by_name(found.std))
        name = f"8-bit sRGB, scaled by {factor:g} after coding, {RESIZED_SCENES} pictures"
        rows.append(_worst_parameter_row(name, ratios, RESIZED_TARGET))
    return rows


def _rolled_off_rows() -> list[Row]:
    """Calibrate pictures whose curve has a shoulder, which is outside the family of curves."""
    rows = []
    for quality in ROLLED_OFF_QUALITIES:
        fault = PictureFault(on_light=[rolled_off(KNEE, STEEPNESS)], jpeg_quality=quality)
        found = calibrated(fault, ROLLED_OFF_SCENES, ROLLED_OFF_SEED, noise=1.0, blur=0.8)
        ratios = [errors(result, scene.camera) / by_name(result.std) for scene, result in found]
        kept = "no JPEG" if quality is None else f"JPEG {quality}"
        name = f"sRGB with compressed highlights, {kept}, {ROLLED_OFF_SCENES} pictures"
        rows.append(_worst_parameter_row(name, ratios, ROLLED_OFF_TARGET))
    return rows


def _filtered_rows() -> list[Row]:
    """Calibrate pictures whose blur is that of the pixels' boxes, and of a filter on the pixels."""
    rows = []
    for blur in FILTER_BLURS:
        fault = PictureFault(on_light=[filtered(blur)] if blur else [])
        found = calibrated(fault, FILTERED_SCENES, FILTERED_SEED, noise=1.0, blur=LENS_BLUR)
        ratios = [errors(result, scene.camera) / by_name(result.std) for scene, result in found]
        applied = f"a filter of {blur:g} px" if blur else "no filter"
        name = f"sRGB, blurred by the pixels' boxes and {applied}, {FILTERED_SCENES} pictures"
        rows.append(_worst_parameter_row(name, ratios, FILTERED_TARGET))
    return rows


def _phone_row() -> Row:
    """Calibrate colour pictures of the folded corner, as a phone writes them, without options."""
    ratios = []
    for seed in range(PHONE_SCENES):
        rng = np.random.default_rng([PHONE_SEED, seed])
        scene = simulate.corner_scene(rng, camera=PHONE)
        quality = int(rng.integers(*PHONE_QUALITIES))
        picture = simulate.render(
            scene, rng, tone="srgb", clutter=12, colour=True, jpeg_quality=quality
        )
        found = ts.calibrate(picture)
        ratios.append(errors(found, scene.camera) / by_name(found.std))
    qualities = f"JPEG {PHONE_QUALITIES[0]}-{PHONE_QUALITIES[1] - 1}"
    name = f"printed corner in colour, 3 megapixels, {qualities}, {PHONE_SCENES} pictures"
    return _worst_parameter_row(name, ratios, PHONE_TARGET)


def _worst_parameter_row(name: str, ratios: list[np.ndarray], target: float) -> Row:
    """Return the row of the errors, in stated stds, of pictures calibrated without options."""
    each = np.sqrt(np.mean(np.square(ratios), axis=0))
    shown = ", ".join(f"{name} {ratio:.2f}" for name, ratio in zip(NAMES, each, strict=True))
    return Row(
        f"{name}: error / std, rms, worst parameter",
        f"{each.max():.2f} ({shown})",
        f"<= {target}",
        bool(each.max() <= target),
    )


def _scores(tone: ToneCurve) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return errors of fx in std, with the curve estimated and known, ratios of std, coverage."""
    estimated, known, ratio = np.zeros((3, SCENES))
    inside = np.zeros((SCENES, len(NAMES)), dtype=bool)
    for seed in range(SCENES):
        rng = np.random.default_rng([SEED, seed])
        scene = simulate.random_scene(rng, kind="square" if seed % 2 else "frame")
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(scene, rng, noise=noise, blur=blur, tone=tone)
        found, stated = (ts.calibrate(picture, tone=given) for given in ("auto", tone))
        estimated[seed] = (found.camera.fx - scene.camera.fx) / found.std["fx"]
        known[seed] = (stated.camera.fx - scene.camera.fx) / stated.std["fx"]
        ratio[seed] = found.std["fx"] / stated.std["fx"]
        inside[seed] = np.abs(errors(found, scene.camera)) < TWO_SIDED_95 * by_name(found.std)
    return estimated, known, ratio, float(inside.mean())
