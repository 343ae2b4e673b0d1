"""Measure how good and how fast trisquare is.

Every benchmark is a module of one of the folders `accuracy`, `finding`, `real` and `speed`, with a
function `measure` that prints details and returns the rows of the table at the end. The rows
replace those in `docs/measured.md` and `benchmarks/results.json`; if a benchmark cannot be
measured, its rows are kept and the exit code is 1. All random draws are seeded; times are ratios
from one run.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time

BENCHMARKS = (
    "accuracy.exactness",
    "accuracy.edge_bound",
    "accuracy.coverage",
    "accuracy.projection",
    "accuracy.undistort",
    "accuracy.plumb_line",
    "accuracy.model_choice",
    "accuracy.fisheye_edges",
    "accuracy.fisheye_pictures",
    "accuracy.rectangles",
    "accuracy.circles",
    "accuracy.lines",
    "accuracy.richer_models",
    "accuracy.broken_assumptions",
    "accuracy.lens_beyond_model",
    "accuracy.decentred_lens",
    "accuracy.held_skew",
    "accuracy.rich_lenses",
    "accuracy.pixel_bound",
    "accuracy.lattice_bound",
    "accuracy.photo_like",
    "finding.refusals",
    "accuracy.prediction",
    "accuracy.tone",
    "accuracy.vignetting",
    "accuracy.varying_blur",
    "accuracy.thin_frames",
    "accuracy.picture_faults",
    "accuracy.against_zhang",
    "accuracy.measured_lengths",
    "real.chess_triples",
    "real.halves",
    "real.printed_edges",
    "accuracy.held_out",
    "finding.inserted_squares",
    "finding.board_finding",
    "finding.gapped_boards",
    "finding.clutter_boards",
    "finding.told_boards",
    "finding.wide_lenses",
    "finding.tags",
    "finding.aprilgrids",
    "accuracy.printed_target",
    "accuracy.sheet_check",
    "finding.robustness",
    "finding.real_scenes",
    "finding.clutter_choice",
    "finding.many_squares",
    "finding.bad_light",
    "speed.picture_time",
    "speed.lattice_time",
    "speed.solve_time",
    "speed.choices_time",
    "speed.command_memory",
    "speed.large_picture",
    "finding.hand_outlines",
    "speed.import_time",
    "speed.demo_time",
    "speed.threads",
    "speed.many_pictures",
    "speed.memory_flat",
    "speed.batch",
    "speed.serve",
    "speed.video",
)

# Together, these take at most ten minutes.
FAST = (
    "exactness",
    "edge_bound",
    "pixel_bound",
    "picture_time",
    "lattice_time",
    "solve_time",
    "command_memory",
    "large_picture",
    "import_time",
    "threads",
    "many_pictures",
)

# One thread each, so that all programs are compared on one core. Read when numpy is imported.
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(words: list[str]) -> int:
    """Run the named benchmarks, or all of them, print one table, and return the exit code."""
    options = _parsed(words)
    if options.compare:
        from harness import results_file

        print("\n".join(results_file.changes()) or "nothing changed")
        return 0
    for variable in THREAD_LIMITS:
        os.environ[variable] = "1"
    from harness import results_file, results_page
    from harness.rows import NotMeasurableError, markdown_table

    rows, missing = [], []
    commit = results_file.current_commit()
    for name in options.names:
        module = importlib.import_module(name)
        print(f"{name}: {module.__doc__.splitlines()[0]}", flush=True)
        conditions, start = results_page.conditions(), time.perf_counter()
        try:
            found = module.measure()
        except NotMeasurableError as error:
            missing.append(f"{name} cannot be measured here, its rows are kept: {error}")
            print(f"  {missing[-1]}", flush=True)
            continue
        for row in found:
            print(f"  {row.name}: {row.result}; required: {row.required or '-'}")
        print(f"  ({time.perf_counter() - start:.1f} s)", flush=True)
        # Written at once, because a run of an hour may be interrupted.
        results_page.update(name, found, BENCHMARKS, conditions)
        results_file.update(name, found, BENCHMARKS, commit)
        rows += found
    if rows:
        print("\n" + markdown_table(rows))
    print("\n".join(missing), file=sys.stderr, end="\n" if missing else "")
    return 1 if missing else 0


def _parsed(words: list[str]) -> argparse.Namespace:
    """Return the options, with the modules of the requested benchmarks as `names`."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="The benchmarks: " + ", ".join(BENCHMARKS) + ".",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="such as exactness; default: all")
    parser.add_argument(
        "--fast", action="store_true", help="run those of speed and headline accuracy"
    )
    parser.add_argument(
        "--compare", action="store_true", help="only print what differs from the committed results"
    )
    options = parser.parse_args(words)
    modules = {module.partition(".")[2]: module for module in BENCHMARKS}
    modules |= {module: module for module in BENCHMARKS}
    names = options.names or (FAST if options.fast else BENCHMARKS)
    unknown = sorted(set(names) - set(modules))
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}: choose among {', '.join(BENCHMARKS)}")
    options.names = [modules[name] for name in names]
    return options


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
