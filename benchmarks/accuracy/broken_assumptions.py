"""Pictures that violate an assumption: silently wrong results, wrong causes, false warnings.

Silently wrong: fx is off by more than 4 std and 0.3 %, and no warning names the cause. The same
scenes are also calibrated without the violation.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare_scenes.broken_assumptions import KINDS, Kind

SCENES = 30
SEED = 1206
WRONG_STDS, WRONG_SHARE = 4.0, 0.003
"""A focal length is wrong if its error exceeds both limits, in its own std and as a fraction."""

MAX_SILENT = 0.01
MAX_SILENT_OF_A_KIND = 3
MAX_FALSE_ALARMS = 0.02
MAX_WRONG_CAUSES = 2

UNCERTAIN = ("correlated_residuals",)
"""Warnings that do not name a cause."""


class Outcome(NamedTuple):
    """Outcome of one case."""

    refused: bool
    wrong: bool
    codes: tuple[str, ...]


def measure(kinds: tuple[str, ...] = tuple(KINDS), seed: int = SEED) -> list[Row]:
    """Print the outcomes of the pictures of each kind, damaged and undamaged."""
    silent, misnamed, warned, refused = {}, {}, 0, 0
    every_cause = {code for kind in KINDS.values() for code in kind.causes} - set(UNCERTAIN)
    for number, (name, kind) in enumerate(KINDS.items()):
        if name not in kinds:
            continue
        damaged = [_outcome(kind, (seed, number, index), True) for index in range(SCENES)]
        sound = [_outcome(kind, (seed, number, index), False) for index in range(SCENES)]
        silent[name] = sum(one.wrong and not set(one.codes) & set(kind.causes) for one in damaged)
        false_causes = every_cause - set(kind.causes)
        misnamed[name] = sum(bool(set(one.codes[:1]) & false_causes) for one in damaged)
        warned += sum(bool(one.codes) for one in sound)
        refused += sum(one.refused for one in sound)
        print(
            f"  {name}: silent {silent[name]}, wrong cause first {misnamed[name]}, "
            f"wrong {sum(one.wrong for one in damaged)}, refused "
            f"{sum(one.refused for one in damaged)}; first {_counted(damaged, first=True)}; any "
            f"{_counted(damaged, first=False)}; undamaged: {_counted(sound, first=False)}, "
            f"refused {sum(one.refused for one in sound)}, wrong {sum(one.wrong for one in sound)}",
            flush=True,
        )
    count = SCENES * len(silent)
    share = sum(silent.values()) / count
    detectable = [name for name in silent if KINDS[name].is_detectable]
    worst = max(detectable, key=lambda name: silent[name])
    misnamed_worst = max(detectable, key=lambda name: misnamed[name])
    name = f"{len(silent)} kinds x {SCENES} scenes"
    return [
        Row(
            f"{name}: silently wrong",
            f"{100 * share:.1f} %",
            f"<= {100 * MAX_SILENT:.0f} %",
            share <= MAX_SILENT,
        ),
        Row(
            f"{name}, worst detectable kind ({worst}): silently wrong",
            f"{silent[worst]} of {SCENES}",
            f"<= {MAX_SILENT_OF_A_KIND}",
            silent[worst] <= MAX_SILENT_OF_A_KIND,
        ),
        Row(
            f"{name}, worst detectable kind ({misnamed_worst}): wrong cause named first",
            f"{misnamed[misnamed_worst]} of {SCENES}",
            f"<= {MAX_WRONG_CAUSES}",
            misnamed[misnamed_worst] <= MAX_WRONG_CAUSES,
        ),
        Row(
            f"{name} without the violation: false warnings; refused",
            f"{100 * warned / count:.1f} %; {refused}",
            f"<= {100 * MAX_FALSE_ALARMS:.0f} %; 0",
            warned <= MAX_FALSE_ALARMS * count and refused == 0,
        ),
    ]


def _outcome(kind: Kind, seed: tuple[int, ...], damaged: bool) -> Outcome:
    pictures, focal = kind.draw(np.random.default_rng(seed), damaged)
    try:
        result = ts.calibrate(pictures)
    except ts.TrisquareError:
        return Outcome(True, False, ())
    error = abs(result.camera.fx - focal)
    wrong = error > WRONG_STDS * result.std["fx"] and error > WRONG_SHARE * focal
    return Outcome(False, wrong, tuple(warning.code for warning in result.warnings))


def _counted(outcomes: list[Outcome], *, first: bool) -> dict[str, int]:
    every = (code for one in outcomes for code in (one.codes[:1] if first else set(one.codes)))
    return dict(Counter(every).most_common())
