"""Pictures with a fault of the camera or of a program: silently wrong results, false warnings.

Silently wrong: fx is off by more than 4 std and 0.3 %, and no warning names the fault.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import TrisquareError, simulate
from trisquare.simulate.scene import Scene
from trisquare_scenes.picture_faults import (
    UNDAMAGED,
    PictureFault,
    bloomed,
    exposed,
    moved,
    photograph,
    sharpened,
    sloped,
    styled,
    thresholded,
    winged,
    with_relief,
)

SEED = 4711
SCENES = 30  # of each class
NOISE_RANGE = (1.0, 3.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
WRONG_STDS, WRONG_SHARE = 4.0, 0.003
MAX_SILENT = 3
UNDAMAGED_WARNED = 0.02

EXPOSURES = (1.15, 1.3, 1.6)
COLOUR_ERRORS = (0.0005, 0.001, 0.002, 0.004)
RELIEF = 0.01

Generator = np.random.Generator
DrawFault = Callable[[Generator, int], PictureFault]


def _overexposed(rng: Generator, index: int) -> PictureFault:
    return PictureFault(on_light=[exposed(EXPOSURES[index % 3])])


def _overexposed_jpeg(rng: Generator, index: int) -> PictureFault:
    quality = int(rng.integers(80, 96))
    return PictureFault(on_light=[exposed(EXPOSURES[index % 3])], jpeg_quality=quality)


def _bloomed(rng: Generator, index: int) -> PictureFault:
    bloom = bloomed(rng.uniform(0.1, 0.5), rng.uniform(1.5, 5.0))
    return PictureFault(on_light=[exposed(EXPOSURES[1 + index % 2]), bloom])


def _thresholded(rng: Generator, index: int) -> PictureFault:
    return PictureFault(on_coded=[thresholded(None if index % 2 else 128)])


def _chromatic(rng: Generator, index: int) -> PictureFault:
    # Red and blue are mostly scaled in opposite directions, by different amounts.
    error = COLOUR_ERRORS[index % 4] * (1 if index % 8 < 4 else -1)
    return PictureFault(colour_scales=(1.0 - error * rng.uniform(0.4, 1.0), 1.0, 1.0 + error))


def _colour(rng: Generator, index: int) -> PictureFault:
    return PictureFault(colour_scales=(1.0, 1.0, 1.0))


def _sharpened(rng: Generator, index: int) -> PictureFault:
    return PictureFault(on_coded=[sharpened(rng.uniform(0.5, 1.5), rng.uniform(1.0, 2.0))])


def _winged(rng: Generator, index: int) -> PictureFault:
    return PictureFault(on_light=[winged(rng.uniform(0.05, 0.2), rng.uniform(1.5, 4.0))])


def _styled(rng: Generator, index: int) -> PictureFault:
    light = sloped(rng.uniform(0.0, 0.5), rng.uniform(0.0, 360.0))
    return PictureFault(on_light=[light], on_coded=[styled(rng.uniform(4.0, 7.0))])


def _interlaced(rng: Generator, index: int) -> PictureFault:
    # Horizontal displacement of one field, or motion between the fields.
    down = rng.uniform(-1.0, 1.0) if index % 2 else 0.0
    across = rng.uniform(1.0, 3.0) * rng.choice([-1.0, 1.0])
    return PictureFault(second_field=(across, down))


def _moved(rng: Generator, index: int) -> PictureFault:
    return PictureFault(on_light=[moved(rng.uniform(2.0, 6.0), rng.uniform(0.0, 180.0))])


@dataclass(frozen=True, slots=True)
class FaultClass:
    """A fault, the codes of warnings that name it, and the relief of the targets."""

    draw: DrawFault
    codes: frozenset[str] = frozenset()
    relief: float = 0.0


def _named(draw: DrawFault, *codes: str) -> FaultClass:
    return FaultClass(draw, frozenset(codes))


CLASSES = {
    "undamaged": FaultClass(lambda rng, index: UNDAMAGED),
    "undamaged, colour": FaultClass(_colour),
    "overexposed": _named(_overexposed, "overexposed"),
    "overexposed, JPEG 80-95": _named(_overexposed_jpeg, "overexposed"),
    "blooming": _named(_bloomed, "overexposed"),
    "thresholded": _named(_thresholded, "thresholded"),
    "chromatic aberration": _named(_chromatic, "chromatic_aberration"),
    "sharpened": _named(_sharpened, "sharpened", "no_tone_curve"),
    "blur with wide tails": _named(_winged, "no_tone_curve"),
    "S-shaped tone curve, uneven light": _named(_styled, "no_tone_curve"),
    "interlaced": _named(_interlaced, "interlaced"),
    "motion of 2-6 px": _named(_moved, "motion_blurred"),
    "JPEG 30": _named(lambda rng, index: PictureFault(jpeg_quality=30), "no_tone_curve"),
    "targets bent by 1 %": FaultClass(
        lambda rng, index: UNDAMAGED,
        frozenset(["correlated_residuals", "plane_disagrees", "planes_contradict"]),
        RELIEF,
    ),
}


@dataclass(slots=True)
class Tally:
    """Outcomes of the pictures of one class."""

    deviations: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    codes: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    warned: int = 0
    silent: int = 0

    def add(self, picture: np.ndarray, scene: Scene, codes: frozenset[str]) -> None:
        """Calibrate a picture."""
        try:
            found = ts.calibrate(picture)
        except TrisquareError:
            self.refused += 1
            return
        error = found.camera.fx - scene.camera.fx
        self.deviations.append(error / found.std["fx"])
        self.shares.append(abs(error) / scene.camera.fx)
        reported = {warning.code for warning in found.warnings}
        self.codes.update(reported)
        self.warned += bool(reported)
        wrong = abs(self.deviations[-1]) > WRONG_STDS and self.shares[-1] > WRONG_SHARE
        self.silent += wrong and not reported & codes

    def described(self) -> str:
        """Return the line that is printed."""
        spread = float(np.sqrt(np.mean(np.square(self.deviations)))) if self.deviations else 0.0
        median = 100.0 * float(np.median(self.shares)) if self.shares else 0.0
        codes = ", ".join(f"{code} {count}" for code, count in self.codes.most_common())
        return (
            f"answered {len(self.deviations)}, refused {self.refused}, error / std of fx rms "
            f"{spread:.2f}, error median {median:.3f} %, silently wrong {self.silent}; "
            f"{codes or 'no codes'}"
        )


def pictures(name: str, seed: int = SEED) -> Iterator[tuple[np.ndarray, Scene]]:
    """Draw the pictures of a class, each with its scene."""
    kind = CLASSES[name]
    for index in range(SCENES):
        rng = np.random.default_rng([seed, index])
        scene = simulate.random_scene(rng, kind="square" if index % 2 else "frame")
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        if kind.relief:
            scene = with_relief(scene, rng, kind.relief)
        fault = kind.draw(rng, index)
        yield photograph(scene, rng, fault, noise=noise, blur=blur), scene


def measure() -> list[Row]:
    """Print the outcomes of each class; those that no warning explains are silently wrong."""
    rows = []
    for name, kind in CLASSES.items():
        tally = Tally()
        for picture, scene in pictures(name):
            tally.add(picture, scene, kind.codes)
        print(f"  {name}: {tally.described()}", flush=True)
        if kind.codes:
            row = Row(
                f"{name}, {SCENES} pictures: silently wrong",
                f"{tally.silent}",
                f"<= {MAX_SILENT}",
                tally.silent <= MAX_SILENT,
            )
        else:
            row = Row(
                f"{name}, {SCENES} pictures: false warnings; refused; silently wrong",
                f"{tally.warned}; {tally.refused}; {tally.silent}",
                f"<= {UNDAMAGED_WARNED:.0%}; 0; 0",
                tally.warned <= UNDAMAGED_WARNED * SCENES
                and tally.refused == 0
                and tally.silent == 0,
            )
        rows.append(row)
    return rows
