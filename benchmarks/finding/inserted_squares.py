"""Three squares rendered into photographs of boards: found and calibrated.

The squares are seen by another camera than the boards: either the boards or the squares must be
rejected. The correct result is the camera of the squares, or the camera of the photograph if it
shows three boards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from harness.rows import NotMeasurableError, Row
from real.real_pictures import blur_of, noise_of, photographs

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene

PICTURES = 50
SEED = 11
CONTRAST_RANGE = (60.0, 200.0)  # grey levels
JPEG_QUALITY = 85

RIGHT_PERCENT = 0.5  # of fx: distinguishes a calibrated camera from a wrong one
SIGMAS = 4.0

OWN_BOARDS = 3
OWN_FOCAL = 5145.0  # pixels, of the photographs of charuco-cube, the only ones with three boards


@dataclass(frozen=True, slots=True)
class Inserted:
    """A photograph with three squares rendered into it, and their camera."""

    photograph: Path
    picture: Image
    scene: Scene
    settings: dict[str, float]


def inserted_squares(count: int) -> Iterator[Inserted]:
    """Yield `count` pictures: all photographs in turn, then again with other squares."""
    paths = photographs()
    for index in range(count):
        # Neighbours in the list are similar: step through it so that even a few pictures differ.
        path = paths[index * 17 % len(paths)]
        rng = np.random.default_rng([SEED, index])
        yield _insert(path, rng)


def _insert(path: Path, rng: np.random.Generator) -> Inserted:
    background = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    height, width = grey.shape
    kind = "frame" if rng.random() < 0.5 else "square"
    scene = simulate.random_scene(rng, image_size=(width, height), kind=kind)
    targets = tuple(replace(target, dark=rng.random() < 0.5) for target in scene.targets)
    scene = replace(scene, targets=targets)
    settings = {
        "contrast": rng.uniform(*CONTRAST_RANGE),
        "blur": blur_of(grey),
        "noise": noise_of(grey),
    }
    picture = simulate.render_into(background, scene, rng, jpeg_quality=JPEG_QUALITY, **settings)
    return Inserted(path, picture, scene, settings)


def is_own_camera(case: Inserted, result: ts.Calibration) -> bool:
    """Return whether the result is the photograph's own camera, from three of its boards."""
    boards = sum(plane.kind == "chessboard" for plane in result.planes)
    off = abs(result.camera.fx - OWN_FOCAL)
    return (
        case.photograph.parents[1].name == "charuco-cube"
        and boards >= OWN_BOARDS
        and off < SIGMAS * result.std["fx"]
    )


def reports_rejected(result: ts.Calibration) -> bool:
    """Return whether a result names unused targets: among the rejected, or in a warning."""
    return bool(result.rejected) or any("rejected" in text for text in result.warnings)


def measure() -> list[Row]:
    """Print how many pictures were calibrated from squares or boards only, and the errors."""
    name = f"{PICTURES} photographs: calibrated from the squares, from three boards; error of fx"
    if not photographs():
        raise NotMeasurableError("no ../shared/data")
    right, own, percents, deviations = 0, 0, [], []
    for case in inserted_squares(PICTURES):
        label = f"{case.photograph.parent.name}/{case.photograph.name} {case.settings}"
        try:
            found = ts.calibrate(case.picture)
        except ts.TrisquareError as error:
            print(f"  {label}: {error}")
            continue
        if is_own_camera(case, found) and reports_rejected(found):
            print(f"  {label}: the photograph's own camera")
            own += 1
            continue
        error = abs(found.camera.fx - case.scene.camera.fx)
        percents.append(100.0 * error / case.scene.camera.fx)
        deviations.append(error / found.std["fx"])
        if percents[-1] > RIGHT_PERCENT:
            print(f"  {label}: fx {percents[-1]:.2f} % off, {found.warnings}")
            continue
        right += 1
    for unit, values in (("% of fx", percents), ("of its stated std", deviations)):
        median, worst = np.median(values), np.max(values)
        print(f"  error of fx: median {median:.3f}, worst {worst:.3f} {unit}")
    result = (
        f"{right}, {own}; median {np.median(percents):.3f} %, worst {max(percents):.2f} % "
        f"({max(deviations):.1f} std)"
    )
    return [Row(name, result, "all calibrated", right + own == PICTURES)]
