"""Run the experiments and write their page: ``make experiments``.

In `benchmarks`, ``python -m experiments.run [--quick] [--into FOLDER]`` writes ``experiments.md``
and, in the folder ``experiments`` beside it, the plots and ``results.json``. All draws are seeded.
``--quick`` uses a few scenes, to try the code. ``--draw`` measures nothing: it draws the plots and
writes the page again from results.json.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from experiments import gallery, lengths, page, plots, printed_corner, results, sweeps
from run import THREAD_LIMITS

import trisquare as ts

WORKERS = 2
Item = TypeVar("Item")
Found = TypeVar("Found")


class Scenes(NamedTuple):
    """Number of scenes of each experiment."""

    edges: int = 200  # of each level of a sweep
    pictures: int = 30
    boards: int = 8
    corners: int = printed_corner.SCENES
    cameras: int = 12  # of the lengths


QUICK = Scenes(edges=2, pictures=1, boards=0, corners=1, cameras=1)


def main(arguments: Sequence[str]) -> None:
    """Run all experiments, or draw their plots again from the saved results."""
    parser = argparse.ArgumentParser(prog="experiments.run", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="take a few scenes")
    parser.add_argument("--draw", action="store_true", help="draw what results.json holds")
    parser.add_argument("--into", type=Path, default=results.FOLDER.parent, metavar="FOLDER")
    options = parser.parse_args(arguments)
    folder = options.into / results.FOLDER.name
    folder.mkdir(parents=True, exist_ok=True)
    if not options.draw:
        found = measure(QUICK if options.quick else Scenes())
        found["gallery"] = gallery.draw(folder)
        results.write(found, folder)
    found = results.read(folder)
    for name, svg in plots.drawn(found).items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")
    (options.into / "experiments.md").write_text(page.text(found), encoding="utf-8")


def measure(scenes: Scenes) -> results.Results:
    """Run all experiments except the gallery."""
    # One thread each, because the scenes are distributed over processes, which read this when they
    # import numpy.
    os.environ.update(dict.fromkeys(THREAD_LIMITS, "1"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=context) as pool:

        def distributed(
            label: str, function: Callable[[Item], Found], items: Iterable[Item]
        ) -> list[Found]:
            start = time.perf_counter()
            found = list(pool.map(function, items))
            print(f"{label}: {time.perf_counter() - start:.0f} s", flush=True)
            return found

        return {
            "software": {"trisquare": ts.__version__, "opencv": cv2.__version__},
            "scenes": scenes._asdict(),
            "sweeps": {
                sweep.name: [
                    _level(
                        sweep,
                        level,
                        distributed(
                            f"{sweep.name} {at:g}", sweeps.errors_of, _jobs(number, level, scenes)
                        ),
                    )
                    for level, at in enumerate(sweep.levels)
                ]
                for number, sweep in enumerate(sweeps.SWEEPS)
            },
            "corner": _corner(
                distributed("printed corner", printed_corner.errors_of, range(scenes.corners))
            ),
            "sheets": _sheets(
                distributed("other sheets", printed_corner.predicted, range(scenes.corners))
            ),
            "lengths": {
                "simulated": _lengths(
                    distributed("lengths", lengths.simulated, range(scenes.cameras))
                ),
                "real": _lengths(lengths.real()),
            },
        }


def _jobs(sweep: int, level: int, scenes: Scenes) -> list[sweeps.Job]:
    boards = scenes.boards if sweeps.SWEEPS[sweep].boards else 0
    return [
        sweeps.Job(sweep, level, number, number < scenes.pictures, number < boards)
        for number in range(scenes.edges)
    ]


def _level(sweep: sweeps.Sweep, level: int, found: list[dict[str, Any]]) -> results.Results:
    """Summarise a level: errors in pixels, that of k1 in per cent of k1."""
    scale = [1.0] * 4 + [abs(sweeps.true_k1(sweep.setting(level))) / 100.0]
    summaries = {
        name: results.summary(errors, scale) for name, errors in results.by_name(found).items()
    }
    return {"at": sweep.levels[level], **summaries}


def _corner(found: list[dict[str, Any]]) -> results.Results:
    """Compare the mean squared errors of fx, fy, cx, cy over the scenes with answers by all."""
    given = [errors for errors in found if None not in errors.values()]
    squares = {
        name: np.array([np.mean(np.square(error[:4])) for error in errors])
        for name, errors in results.by_name(given).items()
    }
    windows = [f"zhang_{window}" for window in printed_corner.WINDOWS]
    better = min(windows, key=lambda name: float(squares[name].mean()))
    return {
        "scenes": len(found),
        "answered": len(given),
        "better": better,
        "rms": {name: results.rms_of_scenes(own) for name, own in squares.items()},
        "ratio": {
            sheet: results.ratio_of_scenes(squares[sheet], squares[better])
            for sheet in printed_corner.SHEETS
        },
        "by_scene": {name: np.sqrt(own).tolist() for name, own in squares.items()},
    }


def _sheets(found: list[dict[str, float]]) -> dict[str, float]:
    """Return the rms of each sheet's predictions, in units of the current sheet's."""
    predicted = {
        name: float(np.sqrt(np.mean(np.square(own))))
        for name, own in results.by_name(found).items()
    }
    today = next(iter(predicted.values()))
    return {name: own / today for name, own in predicted.items()}


def _lengths(found: list[dict[str, list[float]]]) -> results.Results:
    """Return the rms of relative errors in units of 1e-4, by camera; each dict is of one group.

    The bootstrap resamples groups, because errors of lengths in one photograph are correlated.
    """
    return {
        name: {
            "lengths": sum(len(group) for group in groups),
            **results.rms_of_scenes(
                np.array([np.mean(np.square(group)) for group in groups]) * 1e8
            ),
        }
        for name, groups in results.by_name(found).items()
    }


if __name__ == "__main__":
    main(sys.argv[1:])
