"""The numbers of all experiments, and their file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from harness.truth import Array

FOLDER = Path(__file__).parents[2] / "docs" / "experiments"
FILE = "results.json"

PARAMETERS = ("fx", "fy", "cx", "cy", "k1")
RESAMPLES = 1000
INTERVAL = (2.5, 97.5)  # per cent
BOOTSTRAP_SEED = 19
DIGITS = 4

Results = dict[str, Any]


def summary(errors: Sequence[Sequence[float] | None], scale: Sequence[float]) -> Results:
    """Return the rms error of each parameter in units of `scale`, with an interval.

    The 95 % interval is a bootstrap interval: of rms errors over resampled scenes.
    """
    given = [error for error in errors if error is not None]
    found: Results = {"scenes": len(errors), "answered": len(given)}
    if not given:
        return found
    squares = (np.array(given) / scale) ** 2
    for name, column in zip(PARAMETERS, squares.T, strict=True):
        found[name] = rms_of_scenes(column)
    return found


def rms_of_scenes(squares: Array) -> Results:
    """Return the root of the mean of the scenes' squares, shape (N,), and its 95 % interval."""
    return ratio_of_scenes(squares, np.ones(len(squares)))


def ratio_of_scenes(squares: Array, others: Array) -> Results:
    """Return the ratio of two rms errors over the same scenes, and its 95 % interval."""
    shape = (RESAMPLES, len(squares))
    drawn = np.random.default_rng(BOOTSTRAP_SEED).integers(0, len(squares), shape)
    ratios = np.sqrt(squares[drawn].mean(axis=1) / others[drawn].mean(axis=1))
    low, high = np.percentile(ratios, INTERVAL)
    ratio = float(np.sqrt(squares.mean() / others.mean()))
    return {"rms": ratio, "low": float(low), "high": float(high)}


def by_name(found: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Collect the values of several dicts by key."""
    collected: dict[str, list[Any]] = {}
    for one in found:
        for name, value in one.items():
            collected.setdefault(name, []).append(value)
    return collected


def write(results: Results, folder: Path) -> None:
    """Write the file."""
    text = json.dumps(_rounded(results), indent=1, ensure_ascii=False)
    (folder / FILE).write_text(f"{text}\n", encoding="utf-8")


def read(folder: Path = FOLDER) -> Results:
    """Read the file."""
    found: Results = json.loads((folder / FILE).read_text(encoding="utf-8"))
    return found


def _rounded(value: Any) -> Any:
    """Round every number that is not a count to `DIGITS` digits."""
    if isinstance(value, dict):
        return {name: _rounded(member) for name, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(member) for member in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
