"""Check of printed corners: good sheets that are rejected, and faults that are detected.

Pictures of 960 x 720 pixels, taken from within 15 degrees of the corner's diagonal.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.sheet_check import SheetCheck, check_sheet
from trisquare.printing.target import TargetPage
from trisquare.simulate.scene import Scene
from trisquare_scenes.printed_photograph import printed_photograph
from trisquare_scenes.spoilt_corner import folded_off, stretched, with_bent_face

SEED = 77_000
GOOD = 40
SIZE = (960, 720)  # pixels, smaller than any camera's pictures
GOOD_BOARDS = 5  # which are slower to render
SPOILT = 15
FOLD_OFF = (3.0, 10.0)  # degrees, in either direction
BOW = (0.002, 0.01)  # of the side
STRETCH = (0.005, 0.01)

Spoil = Callable[[Scene, TargetPage, np.random.Generator], tuple[Scene, float]]


def measure() -> list[Row]:
    """Return the results of the checks of all sheets."""
    return [
        _good("corner", "frames", GOOD),
        _good("boards", "chessboards", GOOD_BOARDS),
        *_spoilt("folds 3-10 degrees off", "folded", _folded),
        *_spoilt("one face bent by 0.2-1 % of the side", "flat", _bent),
        *_spoilt("stretched by 0.5-1 % in print", "stretched", _stretched),
    ]


def _good(kind: str, name: str, pictures: int) -> Row:
    checks = [_checked(kind, SEED + number, None)[0] for number in range(pictures)]
    verdicts = [check.verdict for check in checks if check is not None]
    wrong, unknown = verdicts.count("not ok"), verdicts.count("cannot tell")
    return Row(
        f"{pictures} good corners of {name}: not ok; cannot tell; refused",
        f"{wrong}; {unknown}; {pictures - len(verdicts)}",
        "0; 0; 0",
        verdicts.count("ok") == pictures,
    )


def _spoilt(name: str, checked: str, spoil: Spoil) -> list[Row]:
    detected, others, errors, ratios = 0, 0, [], []
    for number in range(SPOILT):
        check, true = _checked("corner", SEED + 1000 + number, spoil)
        if check is None:
            continue
        wrong = [finding for finding in check.findings if finding.verdict == "not ok"]
        own = [finding for finding in wrong if finding.check == checked]
        detected += bool(own)
        others += len(wrong) > len(own)
        for finding in own[:1]:
            assert finding.value is not None
            assert finding.std is not None
            errors.append(abs(finding.value - true) / true)
            ratios.append((finding.value - true) / finding.std)
    rms = float(np.sqrt(np.mean(np.square(ratios))))
    return [
        Row(
            f"{SPOILT} corners, {name}: detected; other values not ok",
            f"{detected}; {others}",
            f"{SPOILT}; 0",
            detected == SPOILT and others == 0,
        ),
        Row(
            f"{SPOILT} corners, {name}: relative error of the measured fault, median, largest; "
            "error / std, rms",
            f"{100 * np.median(errors):.2f} %, {100 * max(errors):.2f} %; {rms:.1f}",
            "",
            None,
        ),
    ]


def _checked(kind: str, seed: int, spoil: Spoil | None) -> tuple[SheetCheck | None, float]:
    """Check a rendered sheet with a correct ruler; return None if the calibration fails."""
    (page,) = ts.printed_target("boards" if kind == "boards" else "corner").pages
    rng = np.random.default_rng(seed)
    scene, true = simulate.corner_scene(rng, page=page, image_size=SIZE), 0.0
    if spoil is not None:
        scene, true = spoil(scene, page, rng)
    picture = printed_photograph(scene, rng)
    try:
        check = check_sheet(ts.calibrate(picture), ruler=100.0)
    except ts.TrisquareError as error:
        print(f"  {kind}, seed {seed}: {type(error).__name__}: {error}")
        return None, true
    off = [finding for finding in check.findings if finding.verdict != "ok"]
    if spoil is None or len(off) != 1:
        for finding in off:
            print(f"  {kind}, seed {seed}: {finding.verdict}: {finding.text}")
    return check, true


def _folded(scene: Scene, page: TargetPage, rng: np.random.Generator) -> tuple[Scene, float]:
    off = rng.choice([-1.0, 1.0]) * rng.uniform(*FOLD_OFF)
    return folded_off(scene, page, int(rng.integers(1, 3)), off), 90.0 - off


def _bent(scene: Scene, page: TargetPage, rng: np.random.Generator) -> tuple[Scene, float]:
    bow = rng.uniform(*BOW)
    bent = with_bent_face(
        scene, int(rng.integers(3)), rng.choice([-1.0, 1.0]) * bow, rng.uniform(0.0, np.pi)
    )
    return bent, bow * page.frames[0].side


def _stretched(scene: Scene, page: TargetPage, rng: np.random.Generator) -> tuple[Scene, float]:
    stretch = rng.uniform(*STRETCH)
    return stretched(scene, rng.choice([-1.0, 1.0]) * stretch), 100.0 * stretch
