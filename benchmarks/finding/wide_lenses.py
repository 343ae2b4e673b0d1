"""Fisheye lenses of 100-190 degrees: boards, tags, AprilGrids, and frames among rectangles.

The dictionary of the tags is not given; tags with a side that is bent by more than a tenth of its
length are not counted. The lens model is `fisheye`, and `auto` for the frames among rectangles.
Warnings of low severity are not counted.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row
from harness.truth import rms

import trisquare as ts
from trisquare import simulate
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sheets.aprilgrids import find_aprilgrids
from trisquare.detection.square_views import bends
from trisquare.measurement.find import search
from trisquare.measurement.squares import Square
from trisquare.simulate.render import Image
from trisquare.simulate.scene import Scene
from trisquare_scenes.wide import (
    scene_among_rectangles,
    wide_aprilgrid_scene,
    wide_board_scene,
    wide_tag_scene,
)

SCENES = 40
SEED = 74
FIELD_RANGE = (100.0, 190.0)  # degrees across the picture's width
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
CONTRAST = 175.0  # grey levels
MIN_FOUND = 38
RATIO = (0.7, 1.3)
NAMES = ("4X4_50", "5X5_250", "6X6_250", "7X7_1000", "APRILTAG_16H5", "APRILTAG_36H11")
MAX_BEND = 0.1
"""Maximum bend of a tag's side, over its chord."""
MIN_READ = 0.97
GRID_SCENES = 20


def measure() -> list[Row]:
    """Print the missed targets, and count those found."""
    return [*_boards(), _tags(), _aprilgrids(), _among_rectangles()]


def _boards() -> list[Row]:
    """Find three boards of 8 x 6 inner corners, each as one plane with all crossings' lines."""
    whole, errors = 0, []
    for number in range(SCENES):
        rng = np.random.default_rng([SEED, number])
        scene = wide_board_scene(rng, simulate.fisheye(rng.uniform(*FIELD_RANGE)))
        try:
            result = ts.calibrate(_picture(scene, rng), model="fisheye", tone="linear")
        except ts.TrisquareError as error:
            print(f"  boards {number}: {error}")
            continue
        whole += len(result.planes) == len(scene.targets)
        if len(result.planes) != len(scene.targets):
            print(f"  boards {number}: {len(result.planes)} planes")
        errors.append(_error(result, scene))
    ratio = rms(np.array(errors))
    boards = f"{SCENES} pictures of three boards of 8 x 6 corners"
    return [
        Row(
            f"{boards}: each found as one plane",
            f"{whole} of {SCENES}",
            f">= {MIN_FOUND}",
            whole >= MIN_FOUND,
        ),
        Row(
            f"{boards}: error / std of fx, rms",
            f"{ratio:.2f} (worst {np.abs(errors).max():.1f})",
            f"{RATIO[0]}-{RATIO[1]}",
            RATIO[0] <= ratio <= RATIO[1],
        ),
    ]


def _tags() -> Row:
    """Find three tags whose dictionary is not stated."""
    tags = read = false = 0
    for index in range(SCENES):
        rng = np.random.default_rng([SEED, 1, index])
        name = NAMES[index % len(NAMES)]
        scene, numbers = wide_tag_scene(rng, simulate.fisheye(rng.uniform(*FIELD_RANGE)), name)
        found = search(_picture(scene, rng), TargetKinds.parse("auto")).found
        seen = [one.outline.tag for one in found if isinstance(one, Square)]
        seen_numbers = [tag.number for tag in seen if tag is not None]
        counted = [own for i, own in enumerate(numbers) if _bend(scene, i) <= MAX_BEND]
        missed = [own for own in counted if own not in seen_numbers]
        if missed:
            print(f"  tags {index}, {name}: missed {missed}")
        tags += len(counted)
        read += len(counted) - len(missed)
        false += sum(own not in numbers for own in seen_numbers)
    return Row(
        f"{SCENES} pictures of three tags: tags found",
        f"{read} of {tags}, {false} false",
        f">= {MIN_READ:.0%}, none false",
        read >= MIN_READ * tags and false == 0,
    )


def _aprilgrids() -> Row:
    """Find three copies of one AprilGrid of 6 x 6 tags."""
    read, every, errors = 0, 0, []
    for index in range(GRID_SCENES):
        rng = np.random.default_rng([SEED, 3, index])
        scene = wide_aprilgrid_scene(rng, simulate.fisheye(rng.uniform(*FIELD_RANGE)))
        picture = _picture(scene, rng)
        tags = [len(grid.tags) for grid in find_aprilgrids(picture)]
        read += sum(tags[: len(scene.targets)])
        every += 36 * len(scene.targets)
        if len(tags) != len(scene.targets):
            print(f"  AprilGrids {index}: in pieces of {tags} tags")
        result = ts.calibrate(picture, model="fisheye", tone="linear")
        errors.append(_error(result, scene))
    ratio = rms(np.array(errors))
    return Row(
        f"{GRID_SCENES} pictures of three AprilGrids of 6 x 6 tags: tags found; error / std of fx, "
        "rms",
        f"{read} of {every}; {ratio:.2f} (worst {np.abs(errors).max():.1f})",
        f">= {MIN_READ:.0%}; {RATIO[0]}-{RATIO[1]}",
        read >= MIN_READ * every and RATIO[0] <= ratio <= RATIO[1],
    )


def _among_rectangles() -> Row:
    """Find three frames among rectangles that are no targets, with an unknown lens model."""
    clean, errors = 0, []
    for index in range(SCENES):
        rng = np.random.default_rng([SEED, 2, index])
        scene = scene_among_rectangles(rng, simulate.fisheye(rng.uniform(*FIELD_RANGE)))
        try:
            result = ts.calibrate(_picture(scene, rng), model="auto", tone="linear")
        except ts.TrisquareError as error:
            print(f"  among rectangles {index}: {error}")
            continue
        codes = {warning.code for warning in result.warnings if warning.severity != "low"}
        if codes:
            print(f"  among rectangles {index}: {result.camera.model}, {', '.join(codes)}")
            continue
        clean += 1
        errors.append(_error(result, scene))
    ratio = rms(np.array(errors))
    return Row(
        f"{SCENES} pictures of three frames and up to three rectangles: answered without a "
        "warning; error / std of fx of these, rms",
        f"{clean} of {SCENES}; {ratio:.2f} (worst {np.abs(errors).max():.1f})",
        f">= {MIN_FOUND}; {RATIO[0]}-{RATIO[1]}",
        clean >= MIN_FOUND and RATIO[0] <= ratio <= RATIO[1],
    )


def _error(result: ts.Calibration, scene: Scene) -> float:
    """Return the error of fx in standard deviations."""
    return float((result.camera.fx - scene.camera.fx) / result.std["fx"])


def _bend(scene: Scene, number: int) -> float:
    along = np.linspace(-0.5, 0.5, 32)
    end = np.full_like(along, 0.5)
    sides = np.stack([[along, -end], [end, along], [-along, end], [-end, -along]]).swapaxes(1, 2)
    seen = scene.image_points(number, sides.reshape(-1, 2))
    return float(bends(seen.reshape(1, *sides.shape))[0])


def _picture(scene: Scene, rng: np.random.Generator) -> Image:
    noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
    return simulate.render(scene, rng, noise=noise, blur=blur, contrast=CONTRAST, tone="linear")
